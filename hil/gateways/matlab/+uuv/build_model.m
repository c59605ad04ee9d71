function build_model(name)
% BUILD_MODEL  Make a model of Simulink like figure 7 of the reference platform: planner, plant with sensors, scopes.
%
%   addpath(FOLDER); addpath(fullfile(FOLDER, 'template'));
%   uuv.build_model('uuv_template');          % then press Run, with uuv-hil gateway json running
%
% The planner's command goes to the plant one step later. The simulation keeps to real time, and ends when all tasks are
% done. Written by MathWorks' documentation, and never run: there was no MATLAB where it was made.
  if nargin < 1
    name = 'uuv_template';
  end
  new_system(name);
  open_system(name);
  user = 'simulink/User-Defined Functions/MATLAB System';
  add_block(user, [name '/Planner'], 'System', 'uuv.PlannerSystem', 'Position', [60 60 200 220]);
  add_block('simulink/Discrete/Unit Delay', [name '/Command'], 'InitialCondition', '[0; 0]', ...
    'SampleTime', '0.05', 'Position', [260 70 300 110]);
  add_block(user, [name '/Plant and sensors'], 'System', 'uuv.VehicleSystem', 'Position', [360 40 520 240]);
  add_block('simulink/Sinks/Stop Simulation', [name '/Done'], 'Position', [260 170 300 200]);
  add_block('simulink/Sinks/Scope', [name '/Position'], 'Position', [600 70 640 110]);
  add_block('simulink/Sinks/Scope', [name '/Laser'], 'Position', [600 160 640 200]);
  add_line(name, 'Planner/1', 'Command/1', 'autorouting', 'on');
  add_line(name, 'Planner/2', 'Done/1', 'autorouting', 'on');
  add_line(name, 'Command/1', 'Plant and sensors/1', 'autorouting', 'on');
  add_line(name, 'Plant and sensors/2', 'Position/1', 'autorouting', 'on');
  add_line(name, 'Plant and sensors/4', 'Laser/1', 'autorouting', 'on');
  for port = 1:5
    add_line(name, sprintf('Plant and sensors/%d', port), sprintf('Planner/%d', port), 'autorouting', 'on');
  end
  set_param(name, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', 'FixedStep', '0.05', 'StopTime', 'inf');
end
