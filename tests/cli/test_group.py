"""Commands that are imported when they are run."""

from dataclasses import dataclass
from typing import Literal

import pytest

from saccade.cli import _UsageError as UsageError
from saccade.cli.group import argument, load_command, option
from saccade.errors import setting
from support.commands import all_commands


def test_the_list_of_commands_says_what_their_help_says(run):
    for name, command in all_commands():
        *group, last = name.split()
        assert f"{last} " in command.epilog
        _, listed, _ = run(*group, "--help")
        summary = command.help.splitlines()[0]
        assert summary in " ".join(listed.replace("│", "").split()), name


def test_help_has_the_output_last_and_fits_into_80_columns(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for name, command in all_commands():
        for paragraph in command.help.split("\n\n"):
            lines = paragraph.splitlines()
            assert len(lines) == 1 or max(map(len, lines)) <= 78, (name, lines)
    _, out, _ = run("slam", "--help")
    titles = [out.index(f"─ {each} ─") for each in ("Options", "Input", "Map", "Output")]
    assert titles == sorted(titles)
    assert max(map(len, out.splitlines())) <= 80


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
