function options = template_options()
% TEMPLATE_OPTIONS  Settings of the template, for a vehicle of 0.3 m radius. Change what you need.
  options.rate = 20;              % Hz, of the loop
  options.time_limit = 900;       % s
  options.show = false;           % laser and camera in a figure
  options.depth = 5;              % m, held
  options.speed = 0.8;            % m/s
  options.lookahead = 2;          % m, of pure pursuit
  options.max_yaw_rate = 0.5;     % rad/s
  options.tolerance = 0.6;        % m, within which a goal is reached
  options.clearance = 0.9;        % m, radius and margin that a path keeps to obstacles
  options.radius = 0.6;           % m, radius and safety that the local planner keeps
  options.range = 6;              % m: what is farther does not count for the local planner
  options.block_within = 2;       % m: a direction is blocked by what is nearer,
  options.free_beyond = 2.6;      % and free again when it is farther than that
  options.sectors = 72;           % of the histogram
end
