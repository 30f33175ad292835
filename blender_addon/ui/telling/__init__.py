# SPDX-License-Identifier: GPL-3.0-or-later
"""How the work stands: one bar for a job, the status bar, the report at its end, whether there is a Python."""
