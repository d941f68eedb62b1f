"""Whom a limb's pixels continue tells whether they are the patient's, whatever was predicted."""

from body_builder import adult_body, standing
from mislabelled_builder import OTHER, seen

from anchorpose.body.limb_proposals import CHAINS
from anchorpose.isolation.view import PixelLabel
from anchorpose.tracker.continuity import Borders, limb_borders, relabelled_limb

BODY = adult_body()
TRUTH = standing(LeftUpLeg=(0.0, 0.0, 35.0), LeftLeg=(0.0, 0.0, -25.0), RightArm=(-20.0, 0.0, 0.0))
LEFT_LEG = next(chain for chain in CHAINS if chain.root == "HipLeft")
TRUNK_AND_THIGHS = ("Hips", "LowerBack", "Spine", "Spine1", "LHipJoint", "RHipJoint", "LeftUpLeg", "RightUpLeg")


def borders(observation) -> dict[str, Borders]:
    found = limb_borders(BODY, TRUTH, observation.pieces, observation.evidence.views)
    return {chain.root: border for chain, border in found.items()}


def test_a_leg_of_the_patient_alone_continues_nobody_else(monkeypatch):
    assert borders(seen(TRUTH, ()))["HipLeft"] == Borders(0.0, 0.0)  # not measured: no limb can be doubtful
    monkeypatch.setattr("anchorpose.tracker.continuity.LEAST_BORDER_M", -1.0)
    found = borders(seen(TRUTH, ()))["HipLeft"]
    assert found.to_others_m == 0.0
    assert found.to_patient_m > 0.1
    assert not found.doubtful


def test_a_shank_below_another_persons_thigh_continues_that_person():
    found = borders(seen(TRUTH, TRUNK_AND_THIGHS))["HipLeft"]
    assert found.to_others_m > found.to_patient_m
    assert found.doubtful


def test_what_a_limb_lay_on_before_becomes_nobodys():
    """The shank lay on its own pixels and is found elsewhere: what nothing covers any more is kept as unclear."""
    observation, moved = seen(TRUTH, ("Head",)), standing(LeftUpLeg=(0.0, 0.0, -20.0), LeftLeg=(0.0, 0.0, -50.0))
    views = relabelled_limb(BODY, TRUTH, moved, LEFT_LEG, observation)
    assert views is not None
    for before, after in zip(observation.evidence.views, views, strict=True):
        gone = before.patient & ~after.patient
        assert gone.sum() > 100
        assert (after.labels[gone] == PixelLabel.CLUTTER).all()
        assert ((before.labels == OTHER) == (after.labels == OTHER)).all()
