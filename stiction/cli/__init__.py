"""The command line `stiction`; commands import what they need when called, so that ``--help`` answers at once.

``app``         the application and its process: signals, standard output
``exit_codes``  exit codes, and the errors that lead to them
``options``     options and arguments that several commands have, checked and converted
``render``      tables, progress and trajectories on a terminal; tables in files
``describe``    scenes, engines, explain, export
``pictures``    new, draw, schema
``run``         run, sweep, replay
``prove``       prove
``judge``       judge, dataset
``compare``     compare and a study: accuracy, cost, hard, hold ..
``campaign``    validate, nightly, check, baseline update
``report``      paper, page, trace
"""
