"""Cityscapes classes of objects by the names that the datasets give them, for layouts that keep these names."""

from __future__ import annotations

from unveil_core.drives.formats import pandaset
from unveil_core.drives.formats.nuscenes import reader as nuscenes

__all__ = ["class_of"]

NAMES: dict[str, str] = {
    **pandaset.BOX_CLASSES,
    **nuscenes.BOX_CLASSES,
    # Waymo and nuPlan
    "Vehicle": "car",
    "Cyclist": "rider",
    # KITTI
    "Van": "car",
    "Truck": "truck",
    "Person_sitting": "person",
    "Tram": "train",
    # Argoverse 2
    "REGULAR_VEHICLE": "car",
    "LARGE_VEHICLE": "truck",
    "BOX_TRUCK": "truck",
    "TRUCK_CAB": "truck",
    "VEHICULAR_TRAILER": "truck",
    "ARTICULATED_BUS": "bus",
    "SCHOOL_BUS": "bus",
    "RAILED_VEHICLE": "train",
    "BICYCLIST": "rider",
    "MOTORCYCLIST": "rider",
    "WHEELED_DEVICE": "bicycle",
    "WHEELED_RIDER": "rider",
    "OFFICIAL_SIGNALER": "person",
    "STROLLER": "person",
    "WHEELCHAIR": "person",
}
"""Names that are not listed, as signs, cones and animals, stay in the street. A rider's box holds what is ridden as well."""
BY_LOWER_CASE = {name.lower(): class_name for name, class_name in NAMES.items()}
"""The datasets agree but for upper and lower case."""


def class_of(name: str) -> str | None:
    """The Cityscapes class of an object's name; None for what stays in the street."""
    return BY_LOWER_CASE.get(name.lower())
