"""What a run leaves behind: telemetry logs, events, paths, pictures, summary."""
