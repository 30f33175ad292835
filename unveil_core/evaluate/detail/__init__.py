"""What PSNR forgives inside the removed region: texture that is blurred, lines that are missing, objects that are still there."""
