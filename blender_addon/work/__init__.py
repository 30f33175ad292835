# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes the worker work and the scene take its results: operators, the batch command, preferences. Imports from all but ui."""
