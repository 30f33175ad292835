"""Parts of ``benchmarks/real_drives/real.py``: the table of drives, where cars stand, what is kept, what runs, what is compared."""
