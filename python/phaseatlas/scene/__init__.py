"""Files as users have them: what each format holds and how it is read."""
