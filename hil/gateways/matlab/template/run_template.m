function result = run_template(vehicle, tasks, options)
% RUN_TEMPLATE  High-level planning as the reference platform has it (Zhang et al. 2022, figure 7): a task scheduler
% gives the goals, A* plans on the map, pure pursuit follows the path, VFH goes round what the laser sees.
%
%   addpath(FOLDER); addpath(fullfile(FOLDER, 'template'));    % FOLDER: what uuv-hil gateway json --matlab prints
%   vehicle = uuv.Vehicle('uuv1');
%   result = run_template(vehicle);                            % the stations of the reference platform
%   result = run_template(vehicle, struct('name', 'goal', 'at', [50 50], 'duration', 0, 'needs', ''));
%   plot(result.track(:, 3), result.track(:, 2));
%
% Each part is a file beside this one. To try one of your own, copy the file into your folder, and change it there:
% MATLAB and Octave take that of the current folder first.
%
%   task_scheduler.m   the next goal             plant.m        commands to the vehicle, and its state
%   known_map.m        the map, inflated         sensors.m      laser and camera, shown if options.show
%   global_planner.m   A*                        plan_step.m    one cycle of scheduler, planners and control
%   pure_pursuit.m     speed and turn rate       local_planner.m    VFH
%
% tasks: a row of structs, with name, at ([north east], m), duration (s), needs (the name of another, or '').
% options: those of template_options.m. result: done, track (rows of time s, north, east m), visited (names, in order),
% paths (one for each goal), cycles, late (share of the cycles that began late: see uuv.Rate), worst (s). Planning a
% path takes longer than a cycle; it is done standing still, and does not count.
  if nargin < 2 || isempty(tasks)
    tasks = paper_tasks();
  end
  if nargin < 3
    options = template_options();
  end
  state = plan_step([], vehicle, tasks, options);
  rate = uuv.Rate(options.rate);
  track = [];
  planned = 0;
  while ~state.done
    [pose, scan] = sensors(vehicle, options);
    if state.time > options.time_limit
      error('uuv:late', 'the tasks are not done within %g s; visited: %s', options.time_limit, ...
        strjoin(state.scheduler.finished, ', '));
    end
    [command, state] = plan_step(state, pose, scan, options);
    plant(vehicle, command, options);
    track(end + 1, :) = [state.time pose.position(1) pose.position(2)];
    if numel(state.paths) > planned    % which it waited for, standing still
      planned = numel(state.paths);
      rate.restart();
    end
    rate.wait();
  end
  vehicle.stop();
  result = struct('done', true, 'track', track, 'visited', {state.scheduler.finished}, 'paths', {state.paths}, ...
    'late', rate.late / max(1, rate.cycles), 'cycles', rate.cycles, 'worst', rate.worst);
end
