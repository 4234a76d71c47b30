"""What the joints are told over time: blending of gaits, steering, commanded references."""
