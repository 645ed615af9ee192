"""The commands of `matest`, one file each, and what they share: arguments and console."""
