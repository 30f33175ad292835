"""Dynamic objects: found from instance ids, tracks, boxes and what other frames see through them."""
