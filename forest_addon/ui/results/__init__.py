"""Results: kept, drawn, shown, heard."""
