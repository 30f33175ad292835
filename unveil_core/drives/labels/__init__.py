"""Label pictures, instance maps and masks as people have them: recognized by their values, and read as one thing."""
