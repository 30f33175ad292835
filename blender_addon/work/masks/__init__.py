# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that the artist draws or paints: pictures of them, which ``unveil mask`` carries into all frames through the scene."""
