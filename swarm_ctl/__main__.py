"""`python -m swarm_ctl` is `swarm-ctl`."""

from swarm_ctl.cli import main

main()
