"""What a study shows: sentences whose numbers are cells of its tables, tables with labels and units, charts as data."""
