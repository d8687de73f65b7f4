"""Templates of 6x6 springs, their counts and where they are positive semidefinite."""

import numpy as np
import pytest

from drake_stiffness.springs import parameter_counts, sparsing_map, spring_template, symmetrisation_map


def test_the_complete_model_of_six_joints_has_258_153_and_62_parameters():
    assert parameter_counts(6) == {"complete": 258, "symmetric": 153, "beam": 62}
    assert parameter_counts(7) == {"complete": 8 * 36 + 7, "symmetric": 8 * 21 + 7, "beam": 8 * 8 + 7}


def test_a_beam_along_x_keeps_the_eight_entries_of_eq_24():
    assert spring_template("beam", "x").names == ("k11", "k22", "k26", "k33", "k35", "k44", "k55", "k66")
    assert spring_template("beam", "x").units[2] == "rad/N"


@pytest.mark.parametrize(("axis", "turn"), [("y", 1), ("z", 2)])
def test_a_beam_along_another_axis_is_the_x_template_turned_cyclically(axis, turn):
    cycle = np.roll(np.eye(3), turn, axis=0)  # carries x onto the new axis and keeps the handedness
    six = np.kron(np.eye(2), cycle)
    pattern = np.abs(spring_template("beam", "x").basis).sum(axis=0) > 0
    expected = six @ pattern @ six.T > 0
    found = np.abs(spring_template("beam", axis).basis).sum(axis=0) > 0
    assert np.array_equal(found, expected)


def test_symmetric_unknowns_stand_at_both_places_and_the_maps_compose():
    M1, M2 = symmetrisation_map(), sparsing_map("z")
    assert M1.shape == (36, 21)
    assert M2.shape == (21, 8)
    values = np.arange(1.0, 9.0)
    K = (M1 @ M2 @ values).reshape(6, 6)
    assert np.array_equal(K, K.T)
    assert np.array_equal(K, spring_template("beam", "z").matrix(values))
    assert np.array_equal(M1.sum(axis=0)[:2], [1, 2])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("name", ["beam", "symmetric"])
def test_the_cone_blocks_say_the_same_as_all_eigenvalues_of_the_full_matrix(name, axis):
    template, rng = spring_template(name, axis), np.random.default_rng(1)
    agreed = {True: 0, False: 0}
    for _ in range(400):
        half = rng.normal(size=(6, 6))
        size = 2.0 if name == "beam" else 0.3
        values = template.values(half @ half.T) + size * rng.normal(size=len(template.entries))
        blocks = [np.where(b >= 0, values[np.maximum(b, 0)], 0.0) for b in template.cone_blocks]
        by_blocks = all(np.linalg.eigvalsh(b)[0] >= 0 for b in blocks)
        by_matrix = bool(np.linalg.eigvalsh(template.matrix(values))[0] >= 0)
        assert by_blocks == by_matrix
        agreed[by_matrix] += 1
    assert min(agreed.values()) > 10


def test_the_full_template_has_36_unknowns_and_no_cone():
    assert len(spring_template("full").entries) == 36
    assert spring_template("full").cone_blocks == ()
    with pytest.raises(ValueError, match="plank"):
        spring_template("plank")
