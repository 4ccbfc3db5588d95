"""The command line `stiction`.

The commands import what they need when they are called, so that ``--help`` starts fast. The modules are:

``app``         the application and its process: signals, standard output
``exit_codes``  exit codes, messages and signals
``overview``    the list of commands in the help
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
