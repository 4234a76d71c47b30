# Not tested: no Docker daemon was available where this was written.
FROM ros:jazzy
RUN apt-get update && apt-get install -y --no-install-recommends python3-colcon-common-extensions
WORKDIR /workspace
COPY . src/snake_sim_ros
RUN rosdep update && rosdep install --from-paths src -yi && rm -rf /var/lib/apt/lists/*
RUN . /opt/ros/jazzy/setup.sh && colcon build
ENTRYPOINT ["/bin/bash", "-c", ". install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "snake_sim_ros", "sim"]
