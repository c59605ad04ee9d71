% A vehicle as a block of Simulink: plant model and sensor module of the template (figure 7 of the reference platform).
%
% In: command, [surge (m/s); yaw_rate (rad/s)]. Out: time (s), position ([north; east; depth] m), heading (rad), ranges
% (Beams x 1, m; NaN: no echo), angles ([angle_min; angle_increment] rad). A step waits for real time.
%
% Written by MATLAB's documentation of matlab.System, and never run: there was no MATLAB where it was made. Its parts,
% uuv.Vehicle, uuv.Rate and the template, are tested in Octave.
classdef VehicleSystem < matlab.System
  properties (Nontunable)
    VehicleName = 'uuv1';
    Host = '127.0.0.1';
    Port = 7450;
    Token = '';            % only from another machine than the gateway's
    Beams = 181;           % of its laser, as in its scenario
    SamplePeriod = 0.05;   % s
  end

  properties (Access = private)
    vehicle
    rate
    options
    began
  end

  methods (Access = protected)
    function setupImpl(self)
      self.vehicle = uuv.Vehicle(self.VehicleName, uuv.Gateway(self.Host, self.Port, self.Token));
      self.options = template_options();
      self.rate = uuv.Rate(1 / self.SamplePeriod);
      self.began = NaN;
    end

    function [time, position, heading, ranges, angles] = stepImpl(self, command)
      plant(self.vehicle, struct('surge', command(1), 'yaw_rate', command(2)), self.options);
      self.rate.wait();
      [pose, scan] = sensors(self.vehicle, self.options);
      if numel(scan.ranges) ~= self.Beams
        error('uuv:beams', 'the laser of %s has %d beams, and the block says %d: change its Beams', ...
          self.VehicleName, numel(scan.ranges), self.Beams);
      end
      now_s = 1e-9 * double(pose.time_ns);
      if isnan(self.began)
        self.began = now_s;
      end
      time = now_s - self.began;
      position = reshape(pose.position, 3, 1);
      heading = pose.heading;
      ranges = scan.ranges;
      angles = [scan.angle_min; scan.angle_increment];
    end

    function releaseImpl(self)
      if ~isempty(self.vehicle)
        self.vehicle.stop();
        self.vehicle.gateway.close();
      end
    end

    function [time, position, heading, ranges, angles] = getOutputSizeImpl(self)
      time = [1 1];
      position = [3 1];
      heading = [1 1];
      ranges = [self.Beams 1];
      angles = [2 1];
    end

    function [time, position, heading, ranges, angles] = getOutputDataTypeImpl(~)
      [time, position, heading, ranges, angles] = deal('double');
    end

    function [time, position, heading, ranges, angles] = isOutputComplexImpl(~)
      [time, position, heading, ranges, angles] = deal(false);
    end

    function [time, position, heading, ranges, angles] = isOutputFixedSizeImpl(~)
      [time, position, heading, ranges, angles] = deal(true);
    end

    function period = getSampleTimeImpl(self)
      period = createSampleTime(self, 'Type', 'Discrete', 'SampleTime', self.SamplePeriod);
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
