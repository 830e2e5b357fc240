"""``python -m headless derive``: strings as the papers print them, counts, refusals."""

import pytest

from headless.cli import main

S2 = (
    "[I01I01[t+I01I01+I02I02[t+I02I02+F]I02[T-I02F]I02F]I01[T-I01I02I02[t+I02I02+F]I02"
    "[T-I02F]I02F]I01I02I02[t+I02I02+F]I02[T-I02F]I02F]"
)


def said(capsys, *arguments):
    assert main(["derive", *arguments]) == 0
    return capsys.readouterr().out.strip()


def test_strings_as_the_papers_print_them(capsys):
    assert said(capsys, "apple", "--generations", "2") == S2
    successor = "I03I03[t+I03I03+F]I03[T-I03F]I03F"
    assert said(capsys, "apple", "--generations", "3") == S2.replace("F", successor)
    assert said(capsys, "apple", "--generations", "0") == "[F]"
    assert said(capsys, "maple", "--generations", "2") == "d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g)"
    assert said(capsys, "whorl-8") == "d(d)+d)[d(d)+d)"


def test_seeds(capsys):
    one = said(capsys, "apple-stochastic", "--generations", "3", "--seed", "1")
    assert said(capsys, "apple-stochastic", "--generations", "3", "--seed", "1") == one
    assert said(capsys, "apple-stochastic", "--generations", "3", "--seed", "2") != one


def test_counts(capsys):
    assert said(capsys, "apple", "--generations", "2", "--count") == "75 symbols, 9 branches"
    assert said(capsys, "maple", "--generations", "12", "--count") == (
        "2,125,762 symbols, 531,440 branches"
    )
    assert said(capsys, "apple", "--generations", "900", "--count").startswith("1e430 symbols")
    lines = said(capsys, "apple-stochastic", "--generations", "3", "--count").splitlines()
    assert lines[0].startswith("expected: ")
    assert len(lines) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["apple", "--generations", "40"], "symbols, more than 50,000,000"),
        (["apple", "--generations", "-1"], "--generations: -1 is out of range"),
        (["apple", "--seed", "-1"], "--seed: -1 is out of range"),
        (["honda-birch"], "not by an L-system"),
        (["aple"], '"aple" is not known'),
    ],
)
def test_refusals(capsys, arguments, words):
    assert main(["derive", *arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.out == ""
