"""Is a robot fit for use? What `legato robot check` finds out, one noun per file."""
