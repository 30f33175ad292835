"""What can be told of footage in seconds: motion, blur, cuts, what hides the street, and whether a solve can work."""
