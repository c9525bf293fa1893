"""The help of every command, and the names and values of options."""

import re
from pathlib import Path

import pytest

from support.commands import all_commands


@pytest.mark.parametrize("name", [name for name, _ in all_commands()])
def test_every_command_has_help_with_an_example(run, name):
    code, out, _ = run(*name.split(), "--help")
    assert code == 0
    assert f"Example: saccade {name} " in " ".join(out.split())


ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "tests").rglob("*.py")]


@pytest.fixture(scope="module")
def written():
    """All that pages and tests say."""
    return "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


@pytest.mark.parametrize(("name", "command"), [*all_commands()])
def test_arguments_have_positions_or_names_never_both(run, written, name, command):
    """Arguments by position are no options; each option is named on a page or in a test."""
    arguments = [each for each in command.assemble_argument_collection() if each.show]
    by_position = [each for each in arguments if each.field_info.is_positional_only]
    options = [each.names for each in arguments if each not in by_position]
    assert all(name.startswith("-") for names in options for name in names)
    usage, help_text = run(*name.split(), "--help")[1].split("\n", 1)
    for each in by_position:
        (word,) = each.names
        assert re.search(rf"\b{word}\b", usage)
        assert f"--{word.lower()}" not in help_text.split()
    for names in options:
        assert re.search(rf"{names[0]}(?![\w-])", written), f"nothing names {names[0]}"


MEANINGS = {
    "--format": "output",
    "--kind": "input",
    "--camera": "detect match",
    "--device": "drive",
    "--fixations": "fit evaluate fixations evaluate scanpaths",
    "--anyway": "merge",
}


def test_an_option_means_one_thing():
    """`--format` is what is written, `--kind` what is read; others belong to their commands."""
    for name, command in all_commands():
        for each in command.assemble_argument_collection():
            meaning = MEANINGS.get(each.names[0], "") if each.names else ""
            if meaning in ("input", "output"):
                assert meaning.title() in [group.name for group in each.parameter.group]
            elif meaning:
                assert name in meaning


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["-f", "png,csv"], None),
        (["-f", "png", "--format", " csv , npz"], None),
        (["--format", "png,xml"], 'Invalid value "xml" for --format. Choose from: "npz"'),
        (["--max", "0"], "max_keypoints: expected at least 1, found 0"),
        (["--presett"], "Unknown option: --presett. Did you mean --preset?"),
    ],
)
def test_values_may_be_separated_by_commas_and_are_checked(run, words, expected):
    code, out, err = run("detect", "absent.png", *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert (expected or "absent.png") in err


def test_control_characters_of_file_names_are_escaped(run, tmp_path):
    (tmp_path / "red\x1b[31m\x07\n.png").write_bytes(b"x")
    code, out, err = run("look", "red\x1b[31m\x07\n.png")
    assert code != 0
    assert (out + err).rstrip("\n").isprintable()
    assert "red\\x1b[31m\\x07" in err
