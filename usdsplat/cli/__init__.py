"""The `usdsplat` command: a module for each thing it does, none loaded before it is named."""
