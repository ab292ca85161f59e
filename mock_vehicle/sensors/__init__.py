"""What a mock vehicle senses."""
