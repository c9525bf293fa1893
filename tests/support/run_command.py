"""Running a command in this process."""

import sys

import pytest

from saccade.cli import main


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["saccade", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    return ended.value.code or 0, printed.out, printed.err
