"""The stages, one a module: what each reads, computes and writes."""
