"""Scores of frames as arrays, so that a long evaluation can be begun again where it ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.resume.checkpoint import FACTS, facts_array, facts_of
from unveil_core.evaluate.detail.scores import DetailScore
from unveil_core.evaluate.frame_scores import FrameScores, Score
from unveil_core.evaluate.provenance import ProvenanceScore

__all__ = ["scores_from_arrays", "scores_to_arrays"]

PLAIN = (
    "name",
    "camera_name",
    "pixels",
    "removed",
    "unobserved",
    "untouched_max",
    "untouched_sum",
    "untouched_values",
    "seconds",
    "lpips",
)
"""Fields of FrameScores that JSON has as they are."""
BY_ID = ("pixels", "true_pixels", "squared")
"""Fields of ProvenanceScore whose keys are numbers, which JSON has not."""


def scores_to_arrays(scores: Sequence[FrameScores]) -> dict[str, NDArray[Any]]:
    """What :func:`scores_from_arrays` reads."""
    arrays: dict[str, NDArray[Any]] = {}
    facts = []
    for k, frame in enumerate(scores):
        facts.append(_facts(frame))
        for name, colors in frame.filled.items():
            arrays[f"{k}/filled/{name}"] = colors
        for name, features in frame.features.items():
            arrays[f"{k}/features/{name}/ours"], arrays[f"{k}/features/{name}/true"] = features
    return {**arrays, FACTS: facts_array(facts)}


def scores_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> list[FrameScores]:
    """The scores, all numbers as they were."""
    scores = [_frame(facts) for facts in facts_of(arrays[FACTS])]
    for path, values in arrays.items():
        if path == FACTS:
            continue
        frame, kind, name = path.split("/")[:3]
        if kind == "filled":
            scores[int(frame)].filled[name] = values
        elif path.endswith("/ours"):
            scores[int(frame)].features[name] = (values, arrays[f"{frame}/features/{name}/true"])
    return scores


def _facts(frame: FrameScores) -> dict[str, Any]:
    return {
        **{name: getattr(frame, name) for name in PLAIN},
        "scores": [[*key, *astuple(score)] for key, score in frame.scores.items()],
        "details": [[*key, *astuple(score)] for key, score in frame.details.items()],
        "objects": [[key, *counts] for key, counts in frame.objects.items()],
        "overlaps": frame.overlaps,
        "provenance": None if frame.provenance is None else _provenance(frame.provenance),
    }


def _provenance(score: ProvenanceScore) -> dict[str, Any]:
    values = {f.name: getattr(score, f.name) for f in fields(score)}
    return {**values, "bins": score.bins.tolist(), **{name: list(values[name].items()) for name in BY_ID}}


def _frame(facts: Mapping[str, Any]) -> FrameScores:
    provenance = facts["provenance"]
    if provenance is not None:
        by_id = {name: {int(key): value for key, value in provenance[name]} for name in BY_ID}
        provenance = ProvenanceScore(**{**provenance, **by_id, "bins": np.array(provenance["bins"])})
    return FrameScores(
        **{name: facts[name] for name in PLAIN},
        scores={(region, method): Score(*values) for region, method, *values in facts["scores"]},
        details={(region, method): DetailScore(*values) for region, method, *values in facts["details"]},
        objects={key: (left, all_of_it) for key, left, all_of_it in facts["objects"]},
        overlaps={name: (both, either) for name, (both, either) in facts["overlaps"].items()},
        provenance=provenance,
    )
