"""The typed client of the REST API (`client.api`) and the `legato` command line (`client.main`)."""
