"""What stands beside the street: facades and poles continued behind removed objects."""
