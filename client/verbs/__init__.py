"""One file per family of verbs; each is imported when its verb is used."""
