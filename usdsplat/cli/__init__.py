"""The `usdsplat` command, with one module per subcommand, which is loaded only when it is used."""
