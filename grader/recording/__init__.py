"""The format on disk, beside the bags of `ros_bag`: the only bridge between the live half and the judging half."""
