"""The figures of the papers, a module each paper: what it published, and what the models here draw."""
