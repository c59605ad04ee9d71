% A vehicle of uuv-hil, from MATLAB (R2020b) and GNU Octave (with its package instrument-control).
%
%   vehicle = uuv.Vehicle('uuv1');                  % over the gateway of this machine
%   vehicle = uuv.Vehicle('uuv1', gateway);         % or over another: see help uuv.Gateway
%
% What it senses; a sample has the field age (s):
%   state = vehicle.state();                        % position [north; east; depth] m, heading, speed, nu, ...
%   scan = vehicle.laser();                         % ranges (m; NaN: no echo), angle_min, angle_increment (rad)
%   sample = vehicle.get('imu');                    % any sensor, by its topic
%   picture = vehicle.camera();                     % rows x columns x 3, uint8
%   [echoes, sample] = vehicle.sonar();             % bins x beams; sample.beams (rad), range_step (m)
%   map = vehicle.map();                            % map.occupied: logical, rows to the north, columns to the east
%   vehicle.subscribe('imu', 50);                   % Hz; vehicle.gateway.next(1) then gives the next one
%
% What it does; all return at once:
%   vehicle.drive('surge', 0.4, 'depth', 3);        % m/s, rad/s: surge sway heave yaw_rate; depth, heading are held
%   vehicle.go_to(6, 5, 2.5);                       % north, east, depth (m); then 'heading', 0.5, ...
%   vehicle.follow([6 6 2; 8 6 2], 'speed', 0.5);
%   vehicle.hold_depth(3);  vehicle.hold_heading(0.5);
%   vehicle.push('x', 10, 'n', 2);                  % N, N m
%   vehicle.thrust([1 1 1 1 0 0]);                  % N, one each
%   vehicle.stop();  vehicle.release();
%   vehicle.wait(30);                               % until what was commanded last is done; an error after 30 s
%
% The simulation of it:
%   vehicle.reset();                                % back to its start, at rest, repaired
%   vehicle.set_pose(10, 5, 3, 0.5);                % north, east, depth (m), heading (rad)
%   vehicle.fail('bow');  vehicle.fail('bow', 'efficiency', 0.5);  vehicle.repair('bow');
%   vehicle.disarm();  vehicle.arm();
%
% A vehicle stops when this program ends, and when it sends nothing to the gateway for the deadman time of
% uuv.Gateway. Units are SI and radians, places NED with depth down, what is along the body is FRD. Errors are
% those of uuv.Gateway, and uuv:over, uuv:late from wait.
classdef Vehicle < handle
  properties (SetAccess = private)
    name
    gateway
  end

  methods
    function self = Vehicle(name, gateway)
      if nargin < 2
        gateway = uuv.Gateway();
      end
      self.name = name;
      self.gateway = gateway;
      self.get('state');   % an error now if it is not there
    end

    function [sample, message] = get(self, sensor)
      % The newest sample of a sensor, by its topic ("state" is the estimate of the vehicle's own software).
      message = self.gateway.ask(struct('do', 'get', 'vehicle', self.name, 'sensor', sensor));
      sample = message.sample;
      sample.age = message.age;
    end

    function state = state(self)
      state = self.get('state');
    end

    function scan = laser(self)
      scan = self.get('laser');
      scan.ranges = uuv.Vehicle.numbers(scan.ranges);
    end

    function [picture, sample] = camera(self, topic)
      % The newest picture; of a camera that sends JPEG its topic is found by itself.
      if nargin > 1
        sample = self.get(topic);
      else
        try
          sample = self.get('camera/image_raw');
        catch problem
          if isempty(strfind(problem.message, '/compressed'))
            rethrow(problem);
          end
          sample = self.get('camera/image_raw/compressed');
        end
      end
      picture = uuv.picture(sample);
    end

    function [echoes, sample] = sonar(self)
      sample = self.get('forward_sonar/image');
      echoes = uuv.echoes(sample);
    end

    function map = map(self)
      % The map that a planner of the vehicle's scenario begins with; south, west, resolution in m.
      map = self.get('map');
      cells = matlab.net.base64decode(map.cells);
      map.occupied = reshape(cells ~= 0, map.columns, []).';
      map = rmfield(map, 'cells');
    end

    function subscribe(self, sensor, rate)
      % Let samples come by themselves, so many a second at most; see next of uuv.Gateway.
      self.gateway.ask(struct('do', 'subscribe', 'vehicle', self.name, 'sensor', sensor, 'rate', rate));
    end

    function unsubscribe(self, sensor)
      self.gateway.ask(struct('do', 'unsubscribe', 'vehicle', self.name, 'sensor', sensor));
    end

    function drive(self, varargin)
      self.command('drive', varargin{:});
    end

    function hold_depth(self, depth, varargin)
      self.command('hold_depth', 'depth', depth, varargin{:});
    end

    function hold_heading(self, heading, varargin)
      self.command('hold_heading', 'heading', heading, varargin{:});
    end

    function go_to(self, north, east, depth, varargin)
      self.command('go_to', 'north', north, 'east', east, 'depth', depth, varargin{:});
    end

    function follow(self, path, varargin)
      % path: a row a point, north, east, depth (m).
      self.command('follow', 'path', path, varargin{:});
    end

    function push(self, varargin)
      self.command('push', varargin{:});
    end

    function thrust(self, newtons)
      self.command('thrust', 'newtons', newtons);
    end

    function stop(self)
      self.command('stop');
    end

    function release(self)
      self.command('release');
    end

    function wait(self, seconds)
      % Wait until what was commanded last is done.
      began = tic;
      answer = self.status();
      while ~answer.done
        if answer.over
          why = answer.error;
          if isempty(why)
            why = 'it was commanded something else';
          end
          error('uuv:over', '%s does not come to what was commanded: %s', self.name, why);
        elseif toc(began) > seconds
          error('uuv:late', '%s has not come to what was commanded within %g s; give it more time', self.name, seconds);
        end
        pause(0.05);
        answer = self.status();
      end
    end

    function answer = status(self)
      % Whether the last command is done, over, and why (error) it will not be done.
      answer = self.gateway.ask(struct('do', 'status', 'vehicle', self.name));
    end

    function arm(self)
      self.command('arm', 'on', true);
    end

    function disarm(self)
      self.command('arm', 'on', false);
    end

    function reset(self)
      self.command('reset');
    end

    function set_pose(self, north, east, depth, heading)
      if nargin < 5
        heading = 0;
      end
      self.command('set_pose', 'north', north, 'east', east, 'depth', depth, 'heading', heading);
    end

    function fail(self, thruster, kind, value)
      % kind: 'off', 'efficiency', 'stuck', 'delayed', 'noisy'; value: share, us, s, share.
      if nargin < 3
        kind = 'off';
      end
      if nargin < 4
        self.command('fail', 'thruster', thruster, 'kind', kind);
      else
        self.command('fail', 'thruster', thruster, 'kind', kind, 'value', value);
      end
    end

    function repair(self, thruster)
      self.command('fail', 'thruster', thruster, 'kind', 'repaired');
    end
  end

  methods (Static)
    function values = numbers(values)
      % What jsondecode makes of numbers of which all, or some, are null.
      if iscell(values)
        values(cellfun(@isempty, values)) = {NaN};
        values = cell2mat(values);
      end
      values = double(values(:));
    end
  end

  methods (Access = private)
    function command(self, what, varargin)
      self.gateway.command(struct('do', what, 'vehicle', self.name, varargin{:}));
    end
  end
end
