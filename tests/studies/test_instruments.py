"""The table of trees by instruments, and the intervals of what two instruments differ by."""

import numpy as np

from studies.flight.plants import AREA, BALL, errors, plant
from studies.validation.instruments import TreesByInstrument, flights, group_of, spread_of

HEAD = "tree,species,source,canopy,date,instrument,height_m,dbh_cm,crown_base_m,crown_diameter_m\n"
LOW, GONE = 0.3, 0.8  # m that the aircraft is short of the drone; share of the width without leaves


def table(folder):
    lines = []
    for k in range(40):
        tree, height = f"QuePet_BR{k % 2:02d}_{k}", 20 + k / 10
        wide = 5 + k / 20
        lines += [
            f"{tree},Quercus petraea,ULS,leaf-on,2019,x,{height},,4.05,{wide}",
            f"{tree},Quercus petraea,ALS,leaf-on,2019,x,{height - LOW},,,{wide}",
            f"{tree},Quercus petraea,ULS,leaf-off,2020,x,{height},,4.05,{GONE * wide}",
            f"{tree},Quercus petraea,FI,,2019,,,{20 + k},,",
        ]
    path = folder / "trees.csv"
    path.write_text(HEAD + "\n".join(lines), encoding="utf-8")
    return TreesByInstrument(path)


def test_differences_are_taken_tree_by_tree_and_plot_by_plot(tmp_path):
    real = table(tmp_path)
    height = real.units("broadleaves", "height_m", "ALS", "ULS")
    assert {unit[0] for unit in height} == {"BR00", "BR01"}
    assert np.allclose(np.concatenate(list(height.values())), -LOW)
    wide = real.units("broadleaves", "crown_diameter_m", "ULS leaf-off", "ULS")
    assert np.allclose(np.concatenate(list(wide.values())), GONE)
    assert not real.units("broadleaves", "crown_base_m", "ALS", "ULS")  # was not measured
    assert not real.units("larch", "height_m", "ALS", "ULS")
    stems = real.stems("Quercus")
    assert stems.shape == (16, 3)
    assert np.allclose(stems.mean(axis=0), [0.395, 21.95, 5.975], atol=0.02)
    assert [group_of(name) for name in ("Larix x", "Picea x", "Salix x")] == [
        "larch",
        "evergreens",
        "broadleaves",
    ]


def test_an_interval_knows_that_trees_of_a_plot_share_its_flights():
    rng = np.random.default_rng(3)
    inside = 0
    for seed in range(40):
        plots = [rng.normal(rng.normal(0, 1), 0.1, 15) for _ in range(9)]
        found = spread_of([(values,) for values in plots], seed)
        inside += found.low <= 0 <= found.high
    assert inside >= 30  # of 40 at 90 %; fewer than 30 by chance in 0.2 %


def test_lines_see_the_stand_from_their_sides_at_the_instrument_s_density():
    lines = flights(20.0, 10.0)
    assert [len(lines[name]) for name in ("ALS", "ULS", "TLS")] == [2, 10, 3]
    west = next(line for line in lines["ULS"] if line.name == "line 90 -30")
    assert np.allclose(west.position, (-30, -10, 60))
    reach = np.tan(np.deg2rad(west.field_deg)) * 60
    assert np.allclose(reach, (20, 60))  # from the stand's near edge to the tip of its far one
    assert np.isclose(west.pulse_rate / np.ptp(west.field_deg), 100e3 / 360)


# -------------------------------------------------------------------------------------------- plants
# Plants told by their echoes: plants are as they are said to be, and errors are those of known cases.


def test_kinds_have_the_same_leaf_area_of_leaves_four_times_as_large():
    ficus, schefflera = plant(0, 0, 1), plant(1, 0, 1)
    for leaves in (ficus, schefflera):
        assert abs(np.pi * (leaves.radius**2).sum() / AREA - 1) < 0.1
        assert np.linalg.norm(leaves.centre, axis=1).max() <= BALL
    assert abs((schefflera.radius**2).mean() / (ficus.radius**2).mean() - 4) < 0.4
    assert (plant(0, 1, 1).centre[0] != ficus.centre[0]).any()


def test_errors_are_none_of_what_differs_and_half_of_what_does_not():
    rng = np.random.default_rng(2)
    heard = rng.standard_normal((2, 4, 40, 2, 6))
    same, new = errors(heard, 3, 1)
    assert 0.35 < same < 0.65  # 320 answers: 0.5 ± 0.028
    assert 0.35 < new < 0.65
    heard[1] += 6.0
    assert errors(heard, 3, 1) == (0.0, 0.0)
