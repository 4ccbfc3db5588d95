"""What runs cost, and against what."""
