# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures in the scene: behind the cameras, of a preview, and for the compositor."""
