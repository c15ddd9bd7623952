"""The `usdsplat` command: one module for each thing it does, none of them loaded before it is named."""
