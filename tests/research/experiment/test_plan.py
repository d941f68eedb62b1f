"""What is run on a recording: the forms of the framework by size of hole."""

from pathlib import Path

from anchorpose.research.experiment.clips import plan_clips
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.costs import usual_costs
from anchorpose.research.experiment.method import LITERAL, OWN, load_methods
from anchorpose.research.experiment.plan import Kind, Plan, ResultStore


def test_every_size_of_hole_is_run_with_and_without_rejection_and_matches_alone_only_at_the_ends(tmp_path: Path):
    config = ExperimentConfig(methods=(LITERAL, OWN), recordings=1, tuned=False)
    plan = Plan(config, load_methods(config.methods), {}, tmp_path, "", ResultStore(tmp_path))
    costs = usual_costs(plan.methods, config)
    for clip in plan_clips(config, None):
        for task in plan.tasks(clip):
            assert costs.of(task, config) > 0
            if task.kind is not Kind.TRACKED:
                continue
            if task.method.key == OWN or clip.scene is not Scene.PAPER:
                assert task.forms == (Form.REFINED,)
            elif task.hole_m in (0.0, 0.15):
                assert task.forms == tuple(Form)
            else:
                assert task.forms == (Form.REFINED, Form.REFINED_ALL)
