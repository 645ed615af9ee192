"""What matest races against."""
