"""Phases, peers, safety and intents of one vehicle; pure, driven by `now`."""
