"""``python -m headless derive``: the string that a species' L-system makes."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem.branching import system_of_grammar
from forest_addon.growth.lsystem.system import Prediction, System, predict, rewrite, written
from forest_addon.growth.lsystem.turtle import system_of
from forest_addon.growth.own_tree.relay import generations_of, write_string
from forest_addon.growth.own_tree.sibling import grow_sibling
from forest_addon.spec import Siblings, SpecError, Species


def run(chosen: argparse.Namespace) -> None:
    """Derive the string."""
    generations = chosen.generations
    species = read_settings(find_species(chosen.species, Path()), Species)
    if species.siblings is not None:
        text = _fitted(find_species(chosen.species, Path()), generations, chosen.seed)
        branches = text.count("[") - text.count("~")
        size = f"{len(text):,} characters, {branches:,} side branches"
        sys.stdout.write((size if chosen.count else text) + "\n")
        return
    system, dialect, generations = _system(species, generations)
    if chosen.count:
        size: Prediction = predict(system, generations)
        symbols, branches = size.symbols, sum(size.letters.get(b, 0) for b in BRANCHES[dialect])
        if not size.exact:
            if system.stochastic and not system.conditional:
                print(f"expected: {written(symbols)} symbols, {written(branches)} branches")
            word = rewrite(system, generations, stream(chosen.seed, "derive"))
            seen = np.bincount(word.codes, minlength=256)
            symbols, branches = len(word), sum(int(seen[ord(b)]) for b in BRANCHES[dialect])
        print(f"{written(symbols)} symbols, {written(branches)} branches")
        return
    word = rewrite(system, generations, stream(chosen.seed, "derive"))
    sys.stdout.write(word.text() + "\n")


# Symbols that begin a side branch.
BRANCHES = {
    "tanveer-2020a": "(+",
    "tanveer-2020b": "(+",
    "simlidar": "[",
    "ABOP": "[",
}


def _fitted(path: Path, generations: int | None, seed: int) -> str:
    """The string of a tree by the grammar that is fitted to the species' template."""

    species, template = load_species(path)
    siblings = species.siblings or Siblings()
    grown = grow_sibling(template, siblings, int(stream(seed, "derive").integers(2**63)))
    if generations is None:
        generations = generations_of(template)
    return write_string(template, grown, siblings.variety, max(generations, 0))


def _system(species: Species, generations: int | None) -> tuple[System, str, int]:

    if species.honda is not None or species.crown is not None:
        way = "branching ratios" if species.crown is None else "its crown's shape and measures"
        raise SpecError(species.name, f"grows by {way}, not by an L-system; it has no string")
    chosen = species.rules or species.grammar
    if generations is not None:
        try:
            chosen = replace(chosen, generations=generations)
        except SpecError as problem:
            raise SpecError("--generations", problem.problem) from None
    if species.rules is None:
        return system_of_grammar(species.grammar), chosen.dialect, chosen.generations
    return system_of(chosen), chosen.dialect, chosen.generations
