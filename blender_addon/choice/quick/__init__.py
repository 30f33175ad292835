# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing many objects quickly: filters and order of the list, similar ones, a rectangle, settings for all that is chosen."""
