"""What the readings show of an effect, and what they do not."""

import numpy as np
from hidden_campaigns import draw, run, table, write

from drake_stiffness.diagnosis.signatures import Scene, signature
from drake_stiffness.diagnosis.suspects import suspects
from drake_stiffness.effects.instruments import TrackerFrame
from drake_stiffness.identification import identify
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task


def scene_of(tmp_path, quantity):
    task = read_task(write(tmp_path, table(run(draw(6, 3)), 1), quantity=quantity))
    o = task.observations()
    return Scene(identify(starting_model(task.model, task.measurements), o).model, o)


def test_displacements_show_how_a_tracker_is_turned_and_not_where_it_stands(tmp_path):
    size = np.linalg.norm(signature(scene_of(tmp_path, "displacement"), TrackerFrame()), axis=0)
    assert (size[:3] == 0).all(), "rounding is no signature"
    assert (size[3:] > 1).all()


def test_positions_show_both(tmp_path):
    assert (np.linalg.norm(signature(scene_of(tmp_path, "position"), TrackerFrame()), axis=0) > 100).all()


def test_no_column_of_any_suspect_is_rounding(tmp_path):
    """It is seen well above rounding, or not at all."""
    scene = scene_of(tmp_path, "displacement")
    small = [
        (suspect.name, size)
        for suspect in suspects(scene.model)
        for effect in suspect.variants[:6]
        for size in np.linalg.norm(signature(scene, effect), axis=0)
        if 0 < size < 1e-4
    ]
    assert small == []
