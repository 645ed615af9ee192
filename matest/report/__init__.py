"""Reports: result folders, pages, pictures, plots and tables for the terminal."""
