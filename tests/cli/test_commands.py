"""The help of every command, and the values of options."""

import pytest

from support.commands import all_commands


@pytest.mark.parametrize("name", [name for name, _ in all_commands()])
def test_every_command_has_help_with_an_example(run, name):
    code, out, _ = run(*name.split(), "--help")
    assert code == 0
    assert f"Example: saccade {name} " in " ".join(out.split())


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
