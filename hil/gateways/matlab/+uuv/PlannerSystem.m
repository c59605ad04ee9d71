% Task scheduler, planners and control of the template as a block of Simulink; its parts are the files of the template.
%
% In: what uuv.VehicleSystem gives. Out: command, [surge (m/s); yaw_rate (rad/s)]; done, once all tasks are.
%
% Written by MATLAB's documentation of matlab.System, and never run: there was no MATLAB where it was made. What it calls
% in each step, plan_step, is tested in Octave.
classdef PlannerSystem < matlab.System
  properties (Nontunable)
    VehicleName = 'uuv1';  % of which it takes the map
    Host = '127.0.0.1';
    Port = 7450;
    Tasks = 'paper_tasks'; % a function that gives the tasks
  end

  properties (Access = private)
    options
    plan
  end

  methods (Access = protected)
    function setupImpl(self)
      self.options = template_options();
      gateway = uuv.Gateway(self.Host, self.Port);
      self.plan = plan_step([], uuv.Vehicle(self.VehicleName, gateway), feval(self.Tasks), self.options);
      gateway.close();
    end

    function [command, done] = stepImpl(self, time, position, heading, ranges, angles)
      pose = struct('time_ns', 1e9 * time, 'position', position, 'heading', heading);
      scan = struct('ranges', ranges, 'angle_min', angles(1), 'angle_increment', angles(2));
      [next, self.plan] = plan_step(self.plan, pose, scan, self.options);
      command = [next.surge; next.yaw_rate];
      done = self.plan.done;
    end

    function [command, done] = getOutputSizeImpl(~)
      command = [2 1];
      done = [1 1];
    end

    function [command, done] = getOutputDataTypeImpl(~)
      command = 'double';
      done = 'logical';
    end

    function [command, done] = isOutputComplexImpl(~)
      [command, done] = deal(false);
    end

    function [command, done] = isOutputFixedSizeImpl(~)
      [command, done] = deal(true);
    end
  end

  methods (Access = protected, Static)
    function mode = getSimulateUsingImpl()
      mode = 'Interpreted execution';
    end

    function shown = showSimulateUsingImpl()
      shown = false;
    end
  end
end
