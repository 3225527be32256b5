"""What all layers share: errors, checks, files, arrays and tables."""
