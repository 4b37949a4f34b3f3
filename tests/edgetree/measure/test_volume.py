"""Volume functions of Laasasenaho (1982)."""

from __future__ import annotations

import math

import pytest

from basetree.errors import InputError
from edgetree.measure import (
    SPECIES,
    Estimate,
    Failure,
    MeasureSettings,
    Species,
    stem_volume,
)


def exactly(value: float) -> Estimate:
    return Estimate(value, 0.0)


# Function 61.3 as it is printed with powers: V = a d^b c^d h^e (h - 1.3)^f, in dm³.
POWERS = {
    "pine": (0.036089, 2.01395, 0.99676, 2.07025, -1.07209),
    "spruce": (0.022927, 1.91505, 0.99146, 2.82541, -1.53547),
    "birch": (0.011197, 2.10253, 0.98600, 3.98519, -2.65900),
}
# Function 61.1, ln V = a + b ln d, as Kangas et al. (2020) print it; fitted to the same trees.
LOGARITHMIC = {"pine": (-2.29450, 2.57025), "spruce": (-2.41218, 2.62463)}


@pytest.mark.parametrize("species", SPECIES)
@pytest.mark.parametrize(("d_cm", "h_m"), [(12.0, 10.0), (20.0, 18.0), (35.0, 25.0)])
def test_diameter_and_height_give_the_printed_function(
    species: Species, d_cm: float, h_m: float
) -> None:
    a, b, c, e, f = POWERS[species]
    expected = a * d_cm**b * c**d_cm * h_m**e * (h_m - 1.3) ** f / 1000
    found = stem_volume(species, exactly(d_cm / 100), exactly(h_m))
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(expected, rel=3e-4)


@pytest.mark.parametrize(
    ("species", "expected_m3"), [("pine", 0.2299), ("spruce", 0.2382), ("birch", 0.2639)]
)
def test_the_volume_by_diameter_alone_at_20_cm(species: Species, expected_m3: float) -> None:
    found = stem_volume(species, exactly(0.2))
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(expected_m3, abs=1e-4)


@pytest.mark.parametrize("species", ["pine", "spruce"])
@pytest.mark.parametrize("d_cm", [10.0, 20.0, 30.0])
def test_two_published_functions_of_the_diameter_agree(species: Species, d_cm: float) -> None:
    a, b = LOGARITHMIC[species]
    found = stem_volume(species, exactly(d_cm / 100))
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(math.exp(a + b * math.log(d_cm)) / 1000, rel=0.05)


@pytest.mark.parametrize("height_m", [None, Estimate(18.0, 0.0)])
def test_the_standard_deviation_contains_function_and_diameter(height_m: Estimate | None) -> None:
    own = stem_volume("spruce", exactly(0.25), height_m)
    found = stem_volume("spruce", Estimate(0.25, 0.01), height_m)
    thicker = stem_volume("spruce", exactly(0.2501), height_m)
    assert isinstance(own, Estimate)
    assert isinstance(found, Estimate)
    assert isinstance(thicker, Estimate)
    assert own.std / own.value == pytest.approx(0.187 if height_m is None else 0.0747)
    from_diameter_m3 = (thicker.value - own.value) / 0.0001 * 0.01
    assert found.std == pytest.approx(math.hypot(own.std, from_diameter_m3), rel=0.01)


def test_the_standard_deviation_contains_the_height() -> None:
    own = stem_volume("birch", exactly(0.25), exactly(20.0))
    found = stem_volume("birch", exactly(0.25), Estimate(20.0, 1.0))
    taller = stem_volume("birch", exactly(0.25), exactly(20.01))
    assert isinstance(own, Estimate)
    assert isinstance(found, Estimate)
    assert isinstance(taller, Estimate)
    assert found.std == pytest.approx(
        math.hypot(own.std, (taller.value - own.value) / 0.01), rel=0.01
    )


def test_outside_the_range_of_the_function_there_is_a_reason() -> None:
    assert stem_volume("pine", exactly(0.7)) == Failure(
        "the volume function for pine does not hold at a DBH of 70.0 cm, only from 1.5 to 50.6 cm"
    )
    assert stem_volume("pine", exactly(0.2), exactly(2.0)) == Failure(
        "the volume function for pine does not hold at a height of 2.0 m, only from 4 m"
    )


def test_an_unknown_species_is_refused() -> None:
    with pytest.raises(InputError, match="species is 'oak': expected pine, spruce or birch"):
        MeasureSettings(species="oak")  # type: ignore[arg-type]


def test_a_measured_stem_has_the_volume_of_its_species(scene, pole, exact) -> None:  # type: ignore[no-untyped-def]
    from dataclasses import replace

    stand = scene(pole(0.3, 0.5, 4.0))
    assert stand.measure(masks=stand.masks()).volume_m3 == Failure("no species given")
    tree = stand.measure(masks=stand.masks(), settings=replace(exact, species="spruce"))
    assert tree.volume_m3 == stem_volume("spruce", tree.dbh_m)
    assert tree.species == "spruce"
