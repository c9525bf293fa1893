"""Commands that are imported when they are run, and how their options are read and shown."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from importlib import import_module
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, cast, get_type_hints

import typer
from typer import BadParameter
from typer.core import TyperCommand, TyperGroup, TyperOption

PANELS = {
    "Input": (
        *("kind", "robot", "topic", "frames", "every", "intrinsics", "baseline", "anyway"),
        *("camera", "columns", "xy", "offset", "drop", "only_present", "preset", "config"),
    ),
    "Map": ("map_file", "save_map", "mode", "start", "merge", "min_common"),
    "Output": (
        *("out", "formats", "maps", "figures", "figure", "film", "scanpath_film", "live", "page"),
        *("rrd", "save_tracks", "checkpoint", "csv", "report", "per_image", "per_sequence"),
        "as_json",
    ),
    "Execution": ("workers", "size", "scheduler", "cluster", "jobs"),
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


class Entry(NamedTuple):
    """A command in the list of its group."""

    panel: str
    """Heading above it."""
    summary: str
    """First line of its help."""
    example: str = ""
    """Words after `saccade`; empty for a group."""


class LazyGroup(TyperGroup):
    """A group that imports the module of a command when it is run, not to list it.

    The command NAME is the function NAME of the module `prefix`NAME.
    """

    prefix: ClassVar[str]
    entries: ClassVar[Mapping[str, Entry]]
    groups: ClassVar[Mapping[str, "type[LazyGroup]"]] = {}
    """Those of the entries that are groups."""
    replaced: ClassVar[Mapping[str, str]] = {}
    """Commands of earlier releases, and what to use instead."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = cast("Any", _Commands(type(self)))

    def list_commands(self, ctx: Any) -> list[str]:
        """The names in their order."""
        return list(self.entries)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command as it is listed; it cannot be run."""
        if cmd_name not in self.entries:
            return None
        entry = self.entries[cmd_name]
        return TyperCommand(cmd_name, help=entry.summary, rich_help_panel=entry.panel)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is run, its name, and the other arguments."""
        if args and args[0] in self.replaced:
            ctx.fail(f"No such command '{args[0]}': use saccade {self.replaced[args[0]]}")
        name, _, others = super().resolve_command(ctx, args)
        return name, self.commands[str(name)], others


class _Commands(Mapping[str, Any]):
    """The commands of a group, each imported when it is looked up."""

    def __init__(self, group: type[LazyGroup]) -> None:
        self._group = group

    def __getitem__(self, name: str) -> Any:
        entry = self._group.entries[name]
        if name in self._group.groups:
            return self._group.groups[name](
                name=name, help=entry.summary, no_args_is_help=True, rich_markup_mode="rich"
            )
        return load_command(self._group.prefix + name, name, entry.example)

    def __iter__(self) -> Iterator[str]:
        return iter(self._group.entries)

    def __len__(self) -> int:
        return len(self._group.entries)


@cache
def load_command(module_name: str, name: str, example: str) -> Any:
    """A command from its module, whose `MEANING`, if there is one, ends the help."""
    module = import_module(module_name)
    function = getattr(module, name)
    words = "\n\n".join(filter(None, (getdoc(function), getattr(module, "MEANING", ""))))
    app = typer.Typer(add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)
    described = app.command(name, cls=Command, help=words, epilog=f"Example: saccade {example}")
    described(flattened(function))
    command: Any = typer.main.get_command(app)
    options = [each for each in command.params if isinstance(each, TyperOption)]
    if len(options) >= MIN_GROUPED:
        panel_of = {each: panel for panel, names in PANELS.items() for each in names}
        for option in options:
            option.rich_help_panel = option.rich_help_panel or panel_of.get(str(option.name))
        panels = [None, *PANELS]  # Typer shows them in the order of their first options
        command.params.sort(
            key=lambda each: (
                panels.index(each.rich_help_panel)
                if each.rich_help_panel in panels
                else len(panels)
            )
        )
    return command


def flattened(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of the options that stand in the dataclasses which `function` takes."""
    hints = get_type_hints(function, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    parameters = []
    for name, given in signature(function).parameters.items():
        if name not in groups:
            parameters.append(given.replace(annotation=hints[name], kind=Parameter.KEYWORD_ONLY))
            continue
        kinds = get_type_hints(groups[name], include_extras=True)
        for field in fields(groups[name]):
            default = Parameter.empty if field.default is MISSING else field.default
            parameters.append(
                Parameter(
                    field.name,
                    Parameter.KEYWORD_ONLY,
                    default=default,
                    annotation=kinds[field.name],
                )
            )

    def call(**values: Any) -> Any:
        for name, kind in groups.items():
            values[name] = kind(**{field.name: values.pop(field.name) for field in fields(kind)})
        return function(**values)

    described: Any = call
    described.__signature__ = signature(function).replace(parameters=parameters)
    described.__annotations__ = {each.name: each.annotation for each in parameters}
    return call
