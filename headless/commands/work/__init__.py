"""Work of the commands, as functions: no words of a command line in, files and sentences out."""
