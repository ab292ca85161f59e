"""`python -m mock_vehicle` is `mock-vehicle`."""

from mock_vehicle.cli import main

main()
