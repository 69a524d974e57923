"""The format on disk: the only bridge between the live half and the judging half."""
