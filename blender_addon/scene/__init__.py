# SPDX-License-Identifier: GPL-3.0-or-later
"""A drive and its results as data of the scene, found again by custom properties. Imports from formats."""
