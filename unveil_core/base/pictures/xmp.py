"""What programs and drones noted with a photograph as XML (Adobe's XMP): kept, but for what shows the photograph as it was, or
speaks of parts of its file that a delivered picture has not.
"""

from __future__ import annotations

from xml.dom import minidom
from xml.parsers.expat import ExpatError

__all__ = ["cleaned_xmp"]

MOST_BYTES = 1 << 18
"""Of a packet: thumbnails are longer than what is kept."""
LEFT_OUT = (
    "http://ns.adobe.com/xap/1.0/g/img/",
    "http://ns.adobe.com/xmp/note/",
    "http://ns.google.com/photos/1.0/image/",
    "http://ns.google.com/photos/1.0/depthmap/",
    "http://ns.google.com/photos/1.0/camera/",
    "http://ns.google.com/photos/1.0/container/",
    "http://ns.google.com/photos/dd/1.0/",
    "http://ns.adobe.com/hdr-gain-map/1.0/",
    "http://ns.apple.com/pixeldatainfo/1.0/",
    "http://ns.apple.com/HDRGainMap/1.0/",
)
"""Beginnings of names of what is left out: thumbnails, second parts of long packets, pictures, depth maps, movies and gain maps
that phones put behind the picture."""
THUMBNAILS = "Thumbnails"
"""In XMP's own namespace."""


def cleaned_xmp(packet: bytes) -> bytes | None:
    """A packet without what is left out, as it was where there is no such; None where it is no XML of UTF-8 or nothing is left."""
    if len(packet) > MOST_BYTES or b"<!DOCTYPE" in packet or b"<!ENTITY" in packet:
        return None
    packet = packet.strip(b"\0")
    try:
        packet.decode("utf-8")
        root = minidom.parseString(packet).documentElement
    except (ExpatError, ValueError, LookupError):
        return None
    if not any(name.encode() in packet for name in LEFT_OUT) and THUMBNAILS.encode() not in packet:
        return packet
    if root is None:
        return None
    try:
        _clean(root)
        return root.toxml().encode("utf-8")
    except RecursionError:
        return None


def _clean(element: minidom.Element) -> None:
    """Take what is left out from an element and all in it."""
    for attribute in list(element.attributes.values()):
        if _is_left_out(attribute.namespaceURI, attribute.localName):
            element.removeAttributeNode(attribute)
    for child in list(element.childNodes):
        if isinstance(child, minidom.Element):
            if _is_left_out(child.namespaceURI, child.localName):
                element.removeChild(child)
            else:
                _clean(child)


def _is_left_out(space: str | None, name: str | None) -> bool:
    return (space or "").startswith(LEFT_OUT) or name == THUMBNAILS
