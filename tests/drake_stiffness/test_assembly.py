"""From cell.yaml to springs: which, with which beam axis, and what is refused."""

import numpy as np
import pytest

from drake_stiffness.assembly import default_beam_axis, make_model, spring_effects
from drake_stiffness.cell import Springs
from drake_stiffness.errors import InputError
from drake_stiffness.springs import parameter_counts


def cell_with(cell, **springs):
    other = cell.model_copy(update={"springs": Springs(**springs)})
    other._path = cell._path
    return other


@pytest.mark.parametrize(("template", "count"), [("full", "complete"), ("symmetric", "symmetric"), ("beam", "beam")])
def test_the_complete_model_has_the_counted_number_of_parameters(arms, cells, arm_name, template, count):
    arm, cell = arms[arm_name], cell_with(cells[arm_name], joints="all", links="all", template=template)
    model = make_model(cell, arm, spring_effects(cell, arm))
    assert model.x.size == parameter_counts(arm.num_joints)[count]
    assert len(set(model.names)) == model.x.size
    if arm.num_joints == 6:
        assert model.x.size == {"full": 258, "symmetric": 153, "beam": 62}[template]


def test_springs_of_prismatic_joints_are_metres_per_newton(arms, cells):
    model = make_model(cells["track"], arms["track"], spring_effects(cells["track"], arms["track"]))
    units = dict(zip(model.names, (p.unit for p in model.parameters), strict=True))
    assert (units["track"], units["turn"]) == ("m/N", "rad/(N m)")
    scales = dict(zip(model.names, (p.scale for p in model.parameters), strict=True))
    length = np.linalg.norm(arms["track"].p_PF, axis=1).mean()
    # a spring of typical rotational compliance at a link's length gives way by that much in translation
    assert scales["track"] == pytest.approx(scales["turn"] * length**2)
    assert scales["upper.k11"] == pytest.approx(scales["upper.k44"] * length**2)
    assert scales["upper.k14"] == pytest.approx(scales["upper.k44"] * length)
    assert (units["upper.k11"], units["upper.k14"], units["upper.k44"]) == ("m/N", "rad/N", "rad/(N m)")


def test_the_default_beam_axis_is_nearest_to_the_way_from_joint_to_spring(arms):
    arm = arms["track"]
    for k, link in enumerate(arm.link_names):
        along = np.linalg.inv(arm.R_PF[k]) @ arm.p_PF[k]
        assert default_beam_axis(arm, link) == "xyz"[np.argmax(np.abs(along))]
    assert default_beam_axis(arms["kr270"], "base_link") == "z"
    assert default_beam_axis(arms["kr270"], "link_2") == "x"


def test_a_stated_beam_axis_counts(arms, cells):
    cell = cell_with(cells["kr270"], links="all", beam_axes={"link_2": "y"})
    effects = {e.where: e for e in spring_effects(cell, arms["kr270"])}
    assert effects["link_2"].beam_axis == "y"
    assert effects["base"].link == "base_link"


def test_only_the_named_springs_are_made_in_chain_order(arms, cells):
    cell = cell_with(cells["kr270"], joints=["joint_5", "joint_2"], links=["link_3", "base_link"])
    assert [(e.kind, e.where) for e in spring_effects(cell, arms["kr270"])] == [
        ("joint_compliance", "joint_2"), ("joint_compliance", "joint_5"), ("base_compliance", "base"), ("link_compliance", "link_3"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("springs", "words"),
    [
        ({"joints": ["joint_7"]}, ["springs.joints", "joint_7", "joint_6"]),
        ({"joints": ["Joint_2"]}, ["Did you mean 'joint_2'"]),
        ({"links": ["link_9"]}, ["springs.links", "link_9"]),
        ({"links": "all", "beam_axes": {"link_9": "x"}}, ["beam_axes", "link_9"]),
    ],
)
def test_springs_that_the_arm_does_not_have_are_refused(arms, cells, springs, words):
    with pytest.raises(InputError) as error:
        spring_effects(cell_with(cells["kr270"], **springs), arms["kr270"])
    for word in words:
        assert word in str(error.value)


def test_a_link_of_zero_length_has_no_default_axis_and_is_asked_for(arms, cells):
    from dataclasses import replace

    arm = arms["kr270"]
    p = arm.p_PF.copy()
    p[4] = 0.0
    short = replace(arm, p_PF=p)
    with pytest.raises(InputError, match=r"link_4.*zero length.*beam_axes: \{link_4: x\}"):
        spring_effects(cell_with(cells["kr270"], links="all"), short)
    spring_effects(cell_with(cells["kr270"], links="all", beam_axes={"link_4": "z"}), short)
    spring_effects(cell_with(cells["kr270"], links="all", template="symmetric"), short)
