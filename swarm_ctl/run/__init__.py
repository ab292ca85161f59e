"""Missions in real time: controllers over links, against mock vehicles or real ones."""
