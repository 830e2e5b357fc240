"""Trees as they are measured: allometry, crowns that fill an envelope, stems that have their diameter."""
