"""Mutants: small changes to the code of a package."""

import random
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

EXCLUDED = ("BitOr", "ExceptionReplacer", "RemoveDecorator", "Variable")
"""Operators whose changes say little: most of them break type annotations or an import."""


@dataclass(frozen=True)
class Mutant:
    """One change: an occurrence in a file where an operator of cosmic-ray can act."""

    path: Path
    operator: str
    occurrence: int

    def source(self) -> str:
        """The file as it would be."""
        changed = mutate_code(self.path.read_text(), get_operator(self.operator)(), self.occurrence)
        assert changed is not None, self
        return str(changed)

    def lines(self) -> tuple[int, str, str]:
        """Where it is, what is there and what would be."""
        pairs = zip(self.path.read_text().splitlines(), self.source().splitlines(), strict=False)
        return next(
            (n, old.strip(), new.strip()) for n, (old, new) in enumerate(pairs, 1) if old != new
        )

    def describe(self) -> str:
        """In one line."""
        line, old, new = self.lines()
        return f"{self.path.parent.name}/{self.path.name}:{line}: {old}  ->  {new}"


def sample(folder: Path, count: int, chance: random.Random) -> tuple[int, list[Mutant]]:
    """How many mutants the files of a folder have, and some, the same fraction of every file."""
    every = []
    for path in sorted(folder.rglob("*.py")):
        nodes = list(ast_nodes(get_ast_from_path(path)))
        for name in operator_names():
            if not any(word in name for word in EXCLUDED):
                operator = get_operator(name)()
                places = sum(len(list(operator.mutation_positions(node))) for node in nodes)
                every += [Mutant(path, name, place) for place in range(places)]
    count = min(count, len(every))
    step, start = len(every) / count, chance.random()
    return len(every), [every[int((start + k) * step)] for k in range(count)]
