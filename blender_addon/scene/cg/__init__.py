# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene made ready for the artist's own objects: what a new file brings put aside, the clean plate under the render."""
