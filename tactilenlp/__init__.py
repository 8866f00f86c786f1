"""Find where an unknown rigid object is, and what shape it has, from touch alone."""
