"""A second, separate generator of measurement campaigns: the guard against inverse crime.

It shares no code with the package under test and must never import it: own kinematics, own NC programs, own drive
integration, own measurement chain, all written from the definitions in the documentation. What it writes is an ordinary
campaign folder, with the true answer on the side; ``bank.write_case`` makes one, ``bank.cases`` lists some hundreds.
"""
