"""The recorder: what an episode publishes becomes rows of a data set."""
