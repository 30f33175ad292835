"""All mechanisms that a run can do without: what each does, in which stage, and the code that goes with it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

from unveil_core.base.errors import SettingsError
from unveil_core.base.mechanisms import on

__all__ = ["MECHANISMS", "Mechanism", "check_mechanisms", "of_stage"]


@dataclass(frozen=True)
class Mechanism:
    """A mechanism.

    Attributes:
        name: by which it is switched off; stage: in which it works.
        apply: functions of this package that only it needs, ``module:name``, what is called first; or whole modules, ``module``.
        says: what it does.
    """

    name: str
    stage: str
    apply: tuple[str, ...]
    says: str

    @property
    def enabled(self) -> bool:
        """Whether it works in this process."""
        return on(self.name)


_LISTED = (
    Mechanism(
        "ground_by_photographs", "reconstruct", ("optimize.ground_start", "ground.by_photographs"),
        "where no LiDAR measured the ground, photographs that agree on it tell where surfels start",
    ),
    Mechanism(
        "path_ahead", "ground", ("inpaint.chart.ahead", "inpaint.chart.plan_view"),
        "the street is followed ahead of the last camera by what is seen of it; else it goes on as the camera drove",
    ),
    Mechanism(
        "rectified_path", "ground", ("inpaint.chart.rectify",),
        "the path is moved so that paint and kerbs keep their lateral offset; else it is the car's way",
    ),
    Mechanism(
        "ground_strays", "ground", ("ground.fit:_strays",), "surfels far under or over the way do not count as ground",
    ),
    Mechanism(
        "measured_ground", "ground", ("ground.terrain:ground_points",),
        "a measured point counts as much as many surfels for the street's height",
    ),
    Mechanism(
        "plain_ground", "ground", ("ground.plain_fit:plain_heights", "ground.plain_fit:_rows"),
        "of noisy heights only a parabola across the street is taken",
    ),
    Mechanism(
        "changing_profile", "ground", ("ground.street_fit:_changes_along",), "the cross profile changes along the street",
    ),
    Mechanism(
        "ground_under_objects", "ground", ("ground.street_fit:_under",),
        "without classes, the ground goes on under what could be removed",
    ),
    Mechanism(
        "ground_to_walls", "ground", ("ground.street_fit:_wall_limit", "ground.fit:_facing"),
        "the ground goes on up to walls and fences that face the street",
    ),
    Mechanism(
        "ground_ahead", "ground", ("ground.street:as_far_as_shown", "ground.street:Ground.prolonged"),
        "the ground goes on ahead as far as labels show that the street does",
    ),
    Mechanism(
        "terrain", "ground", ("ground.terrain", "ground.fit:fit_drive_terrain"),
        "a height field by the drive's points tells what lies behind removed objects beside the street",
    ),
    Mechanism(
        "object_boxes", "remove", ("remove.selection:_is_one", "remove.selection:_hangs"),
        "what lies in an object's box and off the ground goes with it, whatever its label",
    ),
    Mechanism(
        "border_surfels", "remove", ("remove.selection:_with_border",), "surfels that touch removed ones go, too",
    ),
    Mechanism(
        "loose_ends", "remove", ("remove.unsupported",), "without classes, what no masked frame backs goes with an object",
    ),
    Mechanism(
        "missed_objects", "remove", ("remove.missed",), "objects that a frame's labels miss are found by the scene",
    ),
    Mechanism(
        "cut_off_pieces", "remove", ("remove.cut_off",), "pieces that masks drawn by hand cut off are found by colour",
    ),
    Mechanism("remains", "remove", ("remove.remains",), "surfels that only pixels of removed objects show go"),
    Mechanism(
        "shortened", "remove", ("remove.reaching",), "surfels that reach behind removed objects lose what nobody saw of them",
    ),
    Mechanism(
        "light_by_view", "inpaint",
        ("inpaint.light.view_light:light_by_view", "inpaint.chart.looks", "geometry.fields.picture_field"),
        "how bright the ground looks by the place in the picture is calibrated, and taken from the chart",
    ),
    Mechanism(
        "robust_chart", "inpaint", ("inpaint.chart.texels:NearestLooks", "inpaint.chart.texels:Texels.around"),
        "the chart is read twice, so that looks that differ from most of the nearest count for nothing",
    ),
    Mechanism(
        "footprint_hulls", "inpaint", ("inpaint.chart.footprint:_pieces",), "an object stands on the hull of its low surfels",
    ),
    Mechanism(
        "sun", "inpaint",
        (
            "inpaint.light.sun_by_shadows", "inpaint.light.sun", "inpaint.light.sun_kernels", "inpaint.light.shadow_map",
            "inpaint.light.scene_light", "inpaint.light.casters", "inpaint.light.houses",
        ),
        "the sun is looked for by the shadows on the ground; else what is dark around removed objects is their shadow",
    ),
    Mechanism(
        "sun_by_holes", "inpaint", ("inpaint.chart.planted",),
        "a sun that is not clear must fill planted holes better than none",
    ),
    Mechanism(
        "caster_company", "inpaint", ("inpaint.light.casters:_in_company",), "surfels that float alone cast no shadow",
    ),
    Mechanism(
        "lit_wall_feet", "inpaint", ("inpaint.light.casters:lit_at_sunny_walls",), "a sunny wall does not shade its own foot",
    ),
    Mechanism(
        "houses", "inpaint", ("inpaint.light.houses",),
        "houses are solid columns in the shadow map, flush with their facades, and go on beyond the drive's ends",
    ),
    Mechanism(
        "houses_beyond", "inpaint", ("inpaint.light.houses:_ends", "inpaint.light.houses:_End"),
        "houses go on beyond the drive's ends as the shadows there tell",
    ),
    Mechanism(
        "refuted_shade", "inpaint", ("inpaint.light.shade:_refuted",), "cast shadows of which only sunny ground is seen go",
    ),
    Mechanism(
        "moved_shade", "inpaint", ("inpaint.light.shade:_moved",), "cast shadows are moved to where they are seen to lie",
    ),
    Mechanism(
        "corrected_shade", "inpaint", ("inpaint.light.shade:_correction",), "observed shade corrects what the scene casts",
    ),
    Mechanism(
        "sunny_exceptions", "inpaint", ("inpaint.light.darkness:sunny_exceptions",),
        "in shade all along, few sunny places tell nothing of the ground",
    ),
    Mechanism(
        "evident_reach", "inpaint", ("inpaint.light.relight:evident_reach",),
        "shadows around objects reach as far as it is darker there than around planted footprints",
    ),
    Mechanism(
        "ended_shadows", "inpaint", ("inpaint.light.relight:_darker_than_beside",),
        "a dark patch is a shadow only if what is seen around it is brighter",
    ),
    Mechanism(
        "even_sky", "inpaint", ("inpaint.light.relight:under_an_even_sky", "inpaint.light.relight:sky_gain"),
        "without a sun, relighting gives back no more than an even sky",
    ),
    Mechanism(
        "still_dark", "inpaint", ("inpaint.light.relight:still_dark",),
        "ground beside what nobody saw that stays dark when it is relit is invented",
    ),
    Mechanism(
        "levelled_border", "inpaint", ("inpaint.light.relight:levelled_border",),
        "along a shadow's border each texel becomes as bright as its lateral offset",
    ),
    Mechanism(
        "lateral_lines", "inpaint", ("inpaint.fill.lateral_lines",), "lines along the street are carried apart from the ground",
    ),
    Mechanism(
        "quilting", "inpaint", ("inpaint.fill.quilting", "inpaint.fill.texture"),
        "invented ground gets the texture of seen ground",
    ),
    Mechanism(
        "mirrored_texture", "inpaint", ("inpaint.fill.texture:_beside_what_is_known",),
        "offsets that nobody saw get the texture beside them",
    ),
    Mechanism(
        "streets_apart", "inpaint", ("inpaint.chart.street_parts",), "each street between corners is carried by itself",
    ),
    Mechanism(
        "ground_in_view", "inpaint", ("inpaint.frames.new_ground:texels_in_pixels",),
        "invented ground gets surfels wherever a view looks through what was removed",
    ),
    Mechanism(
        "facades", "inpaint",
        ("inpaint.facade.facade_chart", "inpaint.facade.wall_fill", "inpaint.facade.offsets"),
        "facades are completed by other parts of themselves, and the sky over them",
    ),
    Mechanism(
        "carried_stems", "inpaint", ("inpaint.facade.stems",),
        "trunks and posts go on down to the ground where cars hide their feet",
    ),
    Mechanism("sky_over_facades", "inpaint", ("inpaint.upright:sky_behind",), "the sky over facades goes on behind what hid it"),
    Mechanism(
        "carried_facades", "inpaint", ("inpaint.facade.offsets:carried_on", "inpaint.facade.facade_chart:where_hidden"),
        "facades go on where something hides that they do",
    ),
    Mechanism(
        "replaced_walls", "inpaint", ("inpaint.facade.facade_chart:replaced_by",),
        "surfels of walls go where these are completed",
    ),
    Mechanism(
        "deferred_places", "inpaint", ("inpaint.frames.keyframes:sharper_elsewhere",),
        "a keyframe leaves a place to another that sees it much sharper",
    ),
    Mechanism(
        "layered_fill", "inpaint", ("inpaint.frames.layered_fill",),
        "a hole is filled in layers: far ground, what is above the horizon, what is near",
    ),
    Mechanism(
        "local_light", "inpaint", ("inpaint.frames.local_light",), "each frame gets the chart's ground in its own light",
    ),
    Mechanism(
        "distant_from_chart", "inpaint", ("inpaint.frames.propagate:_steep", "inpaint.frames.propagate:_held"),
        "relit pixels far off and along shadows' borders are taken from the chart",
    ),
    Mechanism(
        "reoptimization", "reoptimize", ("optimize.reoptimize:reoptimize",), "the empty scene is fitted to the filled frames",
    ),
    Mechanism(
        "optimized_pixels", "reoptimize", ("inpaint.frames.compose:optimized_pixels",),
        "frames show the fitted scene behind removed objects; else they show what was filled",
    ),
    Mechanism(
        "no_sky_below", "reoptimize", ("inpaint.frames.compose:sky_below",),
        "where the fitted scene would show the sky below the horizon, frames show what was filled",
    ),
    Mechanism(
        "filled_light", "reoptimize", ("inpaint.frames.compose:in_the_light_of",),
        "the fitted scene is as bright in a frame as the frame was filled",
    ),
    Mechanism(
        "carried_photographs", "reoptimize", ("delivery.carried", "delivery.alignment"),
        "what another photograph shows of a place is taken from it",
    ),
    Mechanism(
        "aligned_photographs", "reoptimize", ("delivery.alignment",), "such photographs are moved by a pixel or two to fit",
    ),
    Mechanism(
        "footage_detail", "deliver", ("delivery.detail:BestSource", "delivery.detail:Detail", "delivery.full_size:_detail"),
        "the footage of other frames gives detail at full size",
    ),
    Mechanism(
        "ground_grain", "deliver", ("delivery.shifts", "delivery.full_size:_ground_grain", "delivery.detail:grain_of"),
        "invented ground gets its grain from the footage of ground of its kind",
    ),
    Mechanism(
        "sensor_noise", "deliver", ("delivery.detail:sensor_noise",), "what no footage shows gets noise like the sensor's",
    ),
)  # fmt: skip

MECHANISMS: dict[str, Mechanism] = {mechanism.name: mechanism for mechanism in _LISTED}
"""By name, in the order of the stages."""


def of_stage(stage: str, names: Iterable[str]) -> list[str]:
    """The mechanisms among some that work in a stage, in their order here."""
    wanted = set(names)
    return [m.name for m in _LISTED if m.stage == stage and m.name in wanted]


def check_mechanisms(names: Iterable[str]) -> None:
    """Raises:
    SettingsError: a name that no mechanism has.
    """
    for name in names:
        if name not in MECHANISMS:
            near = difflib.get_close_matches(name, MECHANISMS, 1)
            mend = f"did you mean {near[0]}?" if near else "docs/command.md lists them, under --without"
            raise SettingsError(f"Not a mechanism: {name}", mend=mend)
