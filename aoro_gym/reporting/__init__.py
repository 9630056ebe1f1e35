"""Reports: self-contained pages, plots, and tables and progress in a terminal."""
