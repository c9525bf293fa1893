"""The options of the commands: their help, their values, and their ranges."""

from dataclasses import fields
from math import isfinite

import pytest

from saccade.cli import COMMANDS, EVALUATIONS
from saccade.cli.options import Options
from saccade.errors import RANGE
from support.commands import all_commands, options_of

SUMMARIES = [panel for panels in (COMMANDS, EVALUATIONS) for panel in panels.values()]


def test_the_list_of_commands_says_what_their_help_says():
    listed = [summary for panel in SUMMARIES for summary in panel.values()]
    documented = [command.default_command.__doc__.splitlines()[0] for _, command in all_commands()]
    assert listed == documented


def test_help_fits_into_80_columns_and_has_the_output_last(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for name, command in all_commands():
        code, out, _ = run(*name.split(), "--help")
        assert code == 0
        assert f"Example: saccade {name} " in " ".join(out.split())
        assert max(map(len, out.splitlines())) <= 80
        for each in options_of(command):
            assert each.names[0] in out
    _, out, _ = run("slam", "--help")
    titles = [out.index(f"─ {each} ─") for each in ("Options", "Input", "Map", "Output")]
    assert titles == sorted(titles)


def option_classes(parent=Options):
    for each in parent.__subclasses__():
        yield each
        yield from option_classes(each)


def test_help_states_every_range():
    helps = {}
    for _, command in all_commands():
        for each in options_of(command):
            helps.setdefault(each.keys[-1], []).append(each.parameter.help or "")
    for kind in option_classes():
        for field in fields(kind):
            allowed = field.metadata.get(RANGE)
            if allowed is None:
                continue
            ends = (allowed.low, allowed.high)
            stated = [
                f"{end:g}".removeprefix("0") or "0" for end in ends if isfinite(end) and end > 1
            ]
            assert any(all(end in text for end in stated) for text in helps[field.name]), field.name


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["-f", "png,csv"], None),
        (["-f", "png", "--format", " csv , npz"], None),
        (["--format", "png,xml"], 'Invalid value "xml" for'),
        (["--detector", "sift", "--detector", "must"], "--detector specified multiple times"),
        (["--max", "0"], "max_keypoints: expected at least 1, found 0"),
        (["--max", "many"], '--max: unable to convert "many" into int'),
        (["--spred"], "Unknown option: --spred. Did you mean --spread?"),
        (["--no-spread"], "Unknown option: --no-spread"),
    ],
)
def test_values_may_be_separated_by_commas_and_are_checked(run, words, expected):
    code, out, err = run("detect", "absent.png", *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert (expected or "absent.png") in err


def test_commas_in_the_name_of_a_file_separate_nothing(run, tmp_path):
    (tmp_path / "a,b").mkdir()
    (tmp_path / "maps").mkdir()
    words = ["--images", "maps", "--fixations", "absent.csv", "--model", "a,b,maps"]
    code, _, err = run("evaluate", "fixations", *words)
    assert code == 2
    assert "absent.csv" in err
