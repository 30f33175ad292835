"""What a person says of objects: clicks, strokes, mattes; read, kept, and brought into the pictures that are worked on."""
