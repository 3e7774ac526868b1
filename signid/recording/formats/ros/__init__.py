"""Messages of ROS: their values, joined in time to one table."""
