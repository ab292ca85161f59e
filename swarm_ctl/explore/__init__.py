"""LF-PSO and its baselines, obstacle avoidance and the velocity safety filter; pure numpy."""
