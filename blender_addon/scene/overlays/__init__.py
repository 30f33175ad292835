# SPDX-License-Identifier: GPL-3.0-or-later
"""What is drawn over the 3D view and is no object: points as dots, and two pictures compared."""
