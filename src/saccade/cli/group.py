"""Commands that are imported when they are run, and the fields that are their options."""

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, field, fields
from enum import StrEnum
from functools import cache
from importlib import import_module
from inspect import Parameter, Signature, getdoc
from linecache import getlines
from math import isfinite
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import typer
from typer import BadParameter
from typer.core import TyperCommand, TyperGroup, TyperOption

from saccade.cli.output import emit
from saccade.errors import RANGE
from saccade.settings import field_help

PANELS = {
    "Input": (
        *("kind", "robot", "topic", "frames", "every", "intrinsics", "baseline", "anyway"),
        *("camera", "columns", "xy", "offset", "drop", "only_present", "preset", "config"),
    ),
    "Map": ("map_file", "save_map", "mode", "start", "merge"),
    "Output": (
        *("out", "formats", "maps", "figures", "figure", "film", "scanpath_film", "live", "page"),
        *("rrd", "save_tracks", "checkpoint", "csv", "report", "per_image", "per_sequence"),
        "as_json",
    ),
    "Execution": ("workers", "size", "scheduler", "jobs"),
}
"""Headings in the help of a command, and the parameters below each."""
MIN_GROUPED = 10
"""Options from which on the help of a command has headings."""


class Command(TyperCommand):
    """A command whose options for several values take commas too, and others a single value."""

    def make_parser(self, ctx: Any) -> Any:
        """The parser of the arguments."""
        parser: Any = super().make_parser(ctx)
        parse = parser.parse_args

        def parse_lists(args: list[str]) -> Any:
            values, rest, order = parse(args)
            for param in dict.fromkeys(order):
                if not isinstance(param, TyperOption) or param.is_flag:
                    continue
                if not param.multiple and order.count(param) > 1:
                    raise BadParameter("expected a single value, found several", ctx, param)
                if param.multiple and param.metavar != "FILE":
                    given = values[param.name]
                    values[param.name] = [part for text in given for part in _parts(text)]
            return values, rest, order

        parser.parse_args = parse_lists
        return parser


def _parts(text: str) -> list[str]:
    """Values between commas; commas may be in the name of a file."""
    is_path = Path(text.partition("=")[2] or text).exists()
    return [text] if is_path else [part.strip() for part in text.split(",")]


class LazyGroup(TyperGroup):
    """A group that imports the module of a command when it is run, not to list it.

    The command NAME is the function NAME of the module `prefix`NAME.
    """

    prefix: ClassVar[str]
    panels: ClassVar[Mapping[str, Mapping[str, str]]]
    """Commands by heading, each with an example: the words after `saccade`."""
    groups: ClassVar[Mapping[str, "type[LazyGroup]"]] = {}
    """Those of the commands that are groups."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {
            name: TyperCommand(name, rich_help_panel=panel)
            for panel, examples in self.panels.items()
            for name in examples
        }

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command as it is listed; its file is read only now."""
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            command.help = self._summary(cmd_name)
        return command

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is run, its name, and the other arguments."""
        name, _, others = super().resolve_command(ctx, args)
        return name, self.load(str(name)), others

    def load(self, name: str) -> Any:
        """The command as it is run; those in `commands` are listed only."""
        if name in self.groups:
            return self.groups[name](
                name=name, help=self._summary(name), no_args_is_help=True, rich_markup_mode="rich"
            )
        examples = {name: each for panel in self.panels.values() for name, each in panel.items()}
        return load_command(self.prefix + name, name, examples[name])

    def _summary(self, name: str) -> str:
        """First line of the docstring of a command, read from its file."""
        if name in self.groups:
            return getdoc(self.groups[name]) or ""
        file = Path(__file__).with_name(f"{(self.prefix + name).rpartition('.')[2]}.py")
        source = "".join(getlines(str(file)))  # empty where there is none
        found = re.search(rf'^def {name}\([^"]*"""(.*)', source, re.MULTILINE)
        return found[1] if found else ""


OPTION = "option"
"""Key of the maker of an option, its names and attributes in the metadata of a field."""
METAVARS = {int: "N", Path: "FILE"}
"""Words for the values of options, by their types."""


def option(default: Any = MISSING, *names: str, **attributes: Any) -> Any:
    """A field that is an option of a command; its docstring is the help.

    Args:
        default: its value; without one it has to be given.
        names: `--name` and `-n`; by default the name of the field.
        attributes: of `typer.Option`.
    """
    return field(default=default, metadata={OPTION: (typer.Option, names, attributes)})


def argument(metavar: str, default: Any = MISSING) -> Any:
    """A field that is an argument of a command; its docstring is the help."""
    attributes = {"metavar": metavar}
    return field(default=default, metadata={OPTION: (typer.Argument, (), attributes)})


@cache
def load_command(module_name: str, name: str, example: str) -> Any:
    """The command NAME of a module: a function of dataclasses whose fields are its options.

    Its `Result`, if it has one, is emitted. The help ends with `MEANING` of the module, if any.
    """
    module = import_module(module_name)
    function = getattr(module, name)
    kinds = get_type_hints(function)
    kinds.pop("return", None)
    title = module_name.rpartition(".")[2].replace("_", " ")

    def call(**values: Any) -> None:
        plain = {key: _plain(value) for key, value in values.items()}
        groups = {
            key: kind(**{each.name: plain[each.name] for each in fields(kind)})
            for key, kind in kinds.items()
        }
        result = function(**groups)
        if result is not None:
            emit(result, title, as_json=plain["as_json"], report=plain.get("report"))
            raise typer.Exit(result.code)

    described: Any = call
    parameters = [each for kind in kinds.values() for each in parameters_of(kind)]
    described.__signature__ = Signature(parameters)
    described.__annotations__ = {each.name: each.annotation for each in parameters}
    words = "\n\n".join(filter(None, (getdoc(function), getattr(module, "MEANING", ""))))
    app = typer.Typer(add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)
    app.command(name, cls=Command, help=words, epilog=f"Example: saccade {example}")(described)
    command: Any = typer.main.get_command(app)
    panel_of = {each: panel for panel, names in PANELS.items() for each in names}
    options = [each for each in command.params if isinstance(each, TyperOption)]
    panels = [None, *PANELS]
    command.params.sort(
        key=lambda each: panels.index(panel_of.get(str(each.name))) if each in options else 0
    )
    for each in options if len(options) >= MIN_GROUPED else ():
        each.rich_help_panel = panel_of.get(str(each.name))
    return command


def parameters_of(kind: Any) -> list[Parameter]:
    """The options and arguments of the fields of a dataclass.

    The type of a field says what is accepted, its range (`saccade.errors.setting`) between which
    numbers, its docstring the help.
    """
    hints, texts = get_type_hints(kind), field_help(kind)
    parameters = []
    for each in fields(kind):
        make, names, given = each.metadata.get(OPTION, (typer.Option, (), {}))
        value, wrap = _unwrapped(hints[each.name])
        attributes: dict[str, Any] = {"help": texts.get(each.name, "")}
        if get_origin(value) is Literal:
            value = cast("Any", StrEnum)("Choice", [(word, word) for word in get_args(value)])
        elif value in METAVARS:
            attributes["metavar"] = METAVARS[value]
        allowed = each.metadata.get(RANGE)
        if allowed is not None:
            ends = {"min": allowed.low, "max": allowed.high}
            attributes |= {name: value(end) for name, end in ends.items() if isfinite(end)}
        if each.default is False and not names:  # without --no-name
            names = (f"--{each.name.replace('_', '-')}",)
        hint: Any = Annotated[wrap(value), make(*names, **attributes | given)]
        default = Parameter.empty if each.default is MISSING else each.default
        parameters.append(
            Parameter(each.name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)
        )
    return parameters


def _unwrapped(hint: Any) -> tuple[Any, Callable[[Any], Any]]:
    """The type of a single value, and how the hint is made of it: optional, a list, or both."""
    if get_origin(hint) in (Union, UnionType):
        inner, wrap = _unwrapped(get_args(hint)[0])
        return inner, lambda kind: wrap(kind) | None
    if get_origin(hint) is list:
        return get_args(hint)[0], list.__class_getitem__
    return hint, lambda kind: kind


def _plain(value: Any) -> Any:
    """A value without the enumerations that stand for literals."""
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return value.value if isinstance(value, StrEnum) else value
