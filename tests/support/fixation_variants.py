"""The same fixations, as laboratories and eye trackers write them."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

Option = list[str]


class Seen(NamedTuple):
    """A fixation; a subject's times go on from image to image."""

    image: str
    subject: int
    index: int
    x: float
    y: float
    milliseconds: float
    start: float


def with_times(rows: Iterable[Sequence[str]]) -> list[Seen]:
    """Rows of image, subject, index, x, y and duration, in their order, with times."""
    clock: dict[int, float] = {}
    seen = []
    for image, subject, index, x, y, milliseconds in rows:
        start = clock.get(int(subject), 1000.0) + (400 if int(index) == 0 else 30)
        clock[int(subject)] = start + float(milliseconds)
        seen.append(
            Seen(image, int(subject), int(index), float(x), float(y), float(milliseconds), start)
        )
    return seen


def _write(
    path: Path, rows: Iterable[Iterable[object]], delimiter: str = ","
) -> tuple[Path, Option]:
    path.write_text("".join(delimiter.join(map(str, row)) + "\n" for row in rows), "utf-8")
    return path, []


def _stem(seen: Seen) -> str:
    return Path(seen.image).stem


def _with_commas(*values: float) -> list[str]:
    return [str(value).replace(".", ",") for value in values]


def canonical(seen: list[Seen], folder: Path, name: str = "canonical.csv") -> tuple[Path, Option]:
    """The table that `write_fixations` writes."""
    head = ["image", "subject", "index", "x", "y", "duration_ms"]
    return _write(folder / name, [head, *(each[:6] for each in seen)])


def by_time(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """subject, image, x, y, t, dur (s), in disorder, with names and without suffixes."""
    rows = [
        (f"P{s.subject}", _stem(s), s.x, s.y, s.start, s.milliseconds / 1000) for s in seen[::-1]
    ]
    return _write(folder / "time.csv", [("subject", "image", "x", "y", "t", "dur"), *rows])


def semicolons(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """Semicolons, decimal commas, an index from 1 and another case."""
    rows = [
        [s.subject, s.image.upper(), s.index + 1, *_with_commas(s.x, s.y, s.milliseconds)]
        for s in seen
    ]
    head = ("Participant ID", "Stimulus", "Order", "X (px)", "Y (px)", "Duration [ms]")
    return _write(folder / "semicolons.csv", [head, *rows], ";")


def fixation_report(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """EyeLink's report, with blinks, repeated rows, and an index that goes on."""
    rows: list[Sequence[object]] = []
    for number, s in enumerate(seen):
        image = f"stimuli\\{s.image}"
        row = (f"s{s.subject:02d}", image, number, s.x, s.y, s.milliseconds)
        rows += [row, row] if number % 7 == 0 else [row]
        if number % 11 == 0:
            rows.append((*row[:2], number + 0.5, ".", s.y, 10))
    head = ["RECORDING_SESSION_LABEL", "image", *(f"CURRENT_FIX_{n}" for n in ("INDEX", "X", "Y"))]
    return _write(folder / "report.txt", [[*head, "CURRENT_FIX_DURATION"], *rows], "\t")


def other_names(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """Columns that no one can guess."""
    head = ("who", "what", "horizontal", "vertical", "nth", "ms")
    rows = [(s.subject, s.image, s.x, s.y, s.index, s.milliseconds) for s in seen]
    path, _ = _write(folder / "names.csv", [head, *rows])
    words = "subject=who,image=what,x=horizontal,y=Vertical,index=nth,duration=ms"
    return path, ["--columns", words]


def normalized(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """Fractions of images of 800 x 600."""
    moved = [s._replace(x=(s.x + 0.5) / 800, y=(s.y + 0.5) / 600) for s in seen]
    return canonical(moved, folder, "normalized.csv")[0], ["--xy", "normalized"]


def on_screen(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """Pixels of a screen of 1280 x 1024, in the middle of which images of 800 x 600 were."""
    moved = [s._replace(x=s.x + 240, y=s.y + 212) for s in seen]
    return canonical(moved, folder, "screen.csv")[0], ["--offset", "240,212"]


def eyelink(seen: list[Seen], folder: Path, image: str = "!V IMGLOAD CENTER img/{} 640 512") -> (
    tuple[Path, Option]
):  # fmt: skip
    """A recording of each subject: images in the middle of the screen, the other eye, blinks."""
    recordings = folder / ("asc-" + "".join(filter(str.isalpha, image)))
    recordings.mkdir()
    for subject in sorted({s.subject for s in seen}):
        lines = ["** CONVERTED FROM a.edf", "MSG\t900 DISPLAY_COORDS 0 0 1279 1023"]
        own = [s for s in seen if s.subject == subject]
        for number, s in enumerate(own):
            end = s.start + s.milliseconds
            if s.index == 0:
                lines += [
                    f"MSG\t{s.start - 50} TRIALID {number}",
                    f"START\t{s.start - 20} LEFT RIGHT EVENTS",
                    "EVENTS\tGAZE\tLEFT\tRIGHT\tRATE 1000.00",
                    f"EFIX L {s.start - 19} {s.start - 2}\t17\t  1.0\t 2.0\t 900",
                    f"MSG\t{s.start + 1} 1 " + image.format(s.image),
                ]
            lines.append(
                f"EFIX L   {s.start}\t{end}\t{s.milliseconds}\t{s.x + 240}\t{s.y + 212}\t 9"
            )
            if number % 5 == 0:
                lines += [
                    f"EFIX R   {s.start}\t{end}\t{s.milliseconds}\t  3.0\t  4.0\t 9",
                    f"EFIX L   {end + 1}\t{end + 2}\t1\t   .\t   .\t 0",
                ]
            if number + 1 == len(own) or own[number + 1].index == 0:
                lines += [f"MSG\t{end + 9} !V TRIAL_VAR image {s.image}", f"END\t{end + 9} EVENTS"]
        (recordings / f"ab{subject}.asc").write_text("\n".join(lines) + "\n")
    return recordings, []


def eyelink_variable(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """The same with a trial variable instead of the image's place."""
    path, _ = eyelink(seen, folder, "SYNCTIME {}")
    for recording in path.iterdir():
        lines = recording.read_text().splitlines()
        early = [n for n, line in enumerate(lines) if line.endswith("  1.0\t 2.0\t 900")]
        kept = [line for n, line in enumerate(lines) if n not in early]
        recording.write_text("\n".join(kept) + "\n")
    return path, ["--offset", "240,212"]


def tobii(seen: list[Seen], folder: Path, norm: bool = True) -> tuple[Path, Option]:
    """Tobii Pro Lab's export: a row for each sample, saccades and events among them."""
    head = [
        *("Recording timestamp", "Participant name", "Recording name", "Event"),
        *("Presented Stimulus name", "Presented Media width", "Presented Media height"),
        *("Presented Media position X (DACSpx)", "Presented Media position Y (DACSpx)"),
        *("Eye movement type", "Gaze event duration", "Eye movement type index"),
        *("Fixation point X", "Fixation point Y"),
    ]
    head += ["Fixation point X (MCSnorm)", "Fixation point Y (MCSnorm)"] * norm
    rows: list[Sequence[object]] = []
    for number, s in enumerate(seen):
        start = [int(1000 * s.start), f"Participant{s.subject}", "Recording1"]
        shown = [_stem(s), 1600, 1200, 160, 0]
        screen = [160 + 2 * s.x + 0.5, 2 * s.y + 0.5]  # the center of 2 x 2 pixels
        points = [*screen, *([(s.x + 0.5) / 800, (s.y + 0.5) / 600] * norm)]
        points = _with_commas(*points)
        none = [""] * len(points)
        rows += [
            [*start, "", "", "", "", "", "", "Fixation", 90, number, *points],
            [*start, "ImageStimulusStart", *shown, "", "", "", *none],
            [*start, "", *shown, "Fixation", s.milliseconds, number, *points],
            [*start, "", *shown, "Fixation", s.milliseconds, number, *points],
            [*start, "", *shown, "Saccade", 30, number, *none],
        ]
    return _write(folder / f"tobii{norm}.tsv", [head, *rows], "\t")


def tobii_screen(seen: list[Seen], folder: Path) -> tuple[Path, Option]:
    """The same with positions on the screen alone, on which images had twice their size."""
    return tobii(seen, folder, norm=False)


VARIANTS: tuple[Callable[[list[Seen], Path], tuple[Path, Option]], ...] = (
    *(by_time, semicolons, fixation_report, other_names, normalized, on_screen),
    *(eyelink, eyelink_variable, tobii, tobii_screen),
)
