"""Settings of robot controllers: the payload and tool of a model as Franka, Universal Robots and KUKA state them."""
