function varargout = plan_step(state, varargin)
% PLAN_STEP  One cycle of the template: scheduler, global planner, control, local planner.
%
%   state = plan_step([], vehicle, tasks, options);              % once, which takes the map
%   [command, state] = plan_step(state, pose, scan, options);    % each cycle; command: surge (m/s), yaw_rate (rad/s)
%
% state: time (s since the first), done, map, path, paths, along, scheduler, local, goal, waits.
  if isempty(state)
    [vehicle, tasks, options] = varargin{:};
    state = struct('began', NaN, 'time', 0, 'done', false, 'map', known_map(vehicle, options), 'tasks', tasks, ...
      'goal', [], 'path', [], 'paths', {{}}, 'along', 0, 'scheduler', [], 'local', [], 'waits', false);
    varargout = {state};
    return
  end
  [pose, scan, options] = varargin{:};
  now_s = 1e-9 * double(pose.time_ns);
  if isnan(state.began)
    state.began = now_s;
  end
  state.time = now_s - state.began;
  [goal, state.scheduler] = task_scheduler(state.scheduler, state.tasks, state.time, pose.position, options);
  state.done = state.scheduler.done;
  command = struct('surge', 0, 'yaw_rate', 0, 'aim', pose.heading);
  if ~isempty(goal) && ~isequal(goal, state.goal) && ~state.waits
    state.waits = true;                                % a cycle in which it stops, as planning takes longer than one
    varargout = {command, state};
    return
  end
  if ~isempty(goal) && ~isequal(goal, state.goal)
    state.waits = false;
    state.path = global_planner(state.map, reshape(pose.position(1:2), 1, 2), goal);
    state.paths{end + 1} = state.path;
    state.goal = goal;
    state.along = 0;
    state.local = [];
  end
  if ~isempty(goal) && isnan(state.scheduler.since)    % on its way
    [command, state.along] = pure_pursuit(state.path, state.along, pose.position, pose.heading, options);
    reach = norm(goal - reshape(pose.position(1:2), 1, 2)) + options.radius;
    [command, state.local] = local_planner(state.local, command, scan, pose.heading, reach, options);
  end
  varargout = {command, state};
end
