"""Bad days by the thousand: missions drawn by seed, flown in virtual time, watched every tick."""
