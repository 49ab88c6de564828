"""What the commands do. The commands themselves import it when there is work, so that their help is there at once."""
