"""Commands that are imported when they are run."""

from dataclasses import dataclass
from typing import Literal

import pytest
import typer

from saccade.cli import _UsageError as UsageError
from saccade.cli import app
from saccade.cli.group import argument, load_command, option
from saccade.errors import setting


def groups(group=None):
    """All groups."""
    group = group or typer.main.get_command(app)
    yield group
    for each in group.commands.values():
        if hasattr(each, "commands"):
            yield from groups(each)


def test_the_list_of_commands_says_what_their_help_says():
    for group in groups():
        for name, entry in group.entries.items():
            command = group.commands[name]
            assert command.help.splitlines()[0] == entry.summary, name
            assert hasattr(command, "commands") or f" {name} " in f" {entry.example} "


def test_help_has_the_output_last_and_fits_into_80_columns(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for group in groups():
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                continue
            for paragraph in command.help.split("\n\n"):
                lines = paragraph.splitlines()
                assert len(lines) == 1 or max(map(len, lines)) <= 78, (name, lines)
    _, out, _ = run("slam", "--help")
    titles = [out.index(f"─ {each} ─") for each in ("Options", "Input", "Map", "Output")]
    assert titles == sorted(titles)
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize("words", ["export features", "index features", "merge-maps a b"])
def test_a_command_of_an_earlier_release_names_its_successor(run, words):
    code, out, err = run(*words.split())
    assert (code, out) == (2, "")
    assert f"No such command '{words.split()[0]}': use saccade " in err


@dataclass(frozen=True, kw_only=True)
class Pair:
    kind: Literal["a", "b-c"] = argument("KIND")
    """Kind of the pair."""
    first: int = setting(3, 1, 9)
    """The first
    number."""
    others: list[Literal["x", "y"]] | None = option(None, "--other", "-o")
    third: bool = False


GOT = []


def pair(made: Pair):
    """A pair."""
    GOT.append(made)


def test_fields_of_a_dataclass_are_options():
    command = load_command(__name__, "pair", "")
    kind, first, others, third = command.params[:4]
    assert (kind.metavar, kind.help) == ("KIND", "Kind of the pair.")
    assert (first.help, first.metavar) == ("The first number.", "N")
    assert others.opts == ["--other", "-o"]
    assert (third.opts, third.secondary_opts) == (["--third"], [])
    command(["b-c", "--first", "2", "-o", "x,y", "--third"], standalone_mode=False)
    assert [Pair(kind="b-c", first=2, others=["x", "y"], third=True)] == GOT
    assert {type(each) for each in GOT[0].others} == {str}
    for wrong in (["c"], ["a", "--first", "0"], ["a", "-o", "z"], ["a", "--no-third"]):
        with pytest.raises(UsageError):
            command(wrong, standalone_mode=False)
