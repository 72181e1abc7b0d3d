"""What is measured: errors, tables and claims."""
