"""Commands that are imported when they are run."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer import Option
from typer.core import TyperOption

from saccade.cli import app
from saccade.cli.group import flattened


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


@dataclass(frozen=True)
class Pair:
    first: Annotated[int, Option(min=1)]
    second: Annotated[str, Option()] = "b"


def test_fields_of_a_dataclass_are_options():
    got = []

    def command(pair: Pair, third: Annotated[bool, Option("--third")] = False) -> None:
        got.append((pair, third))

    one = typer.Typer()
    one.command()(flattened(command))
    click = typer.main.get_command(one)
    names = [each.opts[0] for each in click.params if isinstance(each, TyperOption)]
    assert names[:3] == ["--first", "--second", "--third"]
    click(["--first", "2", "--third"], standalone_mode=False)
    assert got == [(Pair(2, "b"), True)]
