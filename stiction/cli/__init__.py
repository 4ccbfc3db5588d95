"""The command line `stiction`. Commands import what they need when called, so that ``stiction --help`` answers at once.

``app``         the application and the process: signals, standard output
``exit_codes``  what a command ends with, and which error leads to which
``options``     options and arguments that several commands have, checked and converted
``render``      tables, progress and trajectories on a terminal; tables in files
``describe``    scenes, engines, explain, export
``pictures``    new, draw, schema
``run``         run, sweep, replay
``prove``       prove
``compare``     compare drift, threshold, torque, cost, effects, suppression, hard, hold
``campaign``    validate, nightly, check, baseline update
``report``      paper, page, trace
"""
