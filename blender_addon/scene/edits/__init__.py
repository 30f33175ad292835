# SPDX-License-Identifier: GPL-3.0-or-later
"""What the artist changes of the scene itself, on its way back into the workspace."""
