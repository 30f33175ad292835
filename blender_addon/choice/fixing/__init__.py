# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking through a result: the doubtful frames first, and paint taken from other frames."""
