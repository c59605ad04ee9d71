% Vehicles of uuv-hil from MATLAB (R2020b) and GNU Octave (with its package instrument-control).
%
%   On the command line:  uuv-hil gateway --connect tcp/192.168.3.116:7447
%   Here:                 addpath(FOLDER)             % that `uuv-hil gateway --matlab` says
%
%   uuv = uuv_hil();                                  % or uuv_hil('127.0.0.1', 7450, TOKEN, DEADMAN)
%   state = uuv.get('uuv1', 'state');                 % state.position: [north; east; depth], m; state.age, s
%   uuv.tell('uuv1', 'drive', 'surge', 0.4, 'depth', 3);
%   uuv.tell('uuv1', 'go_to', 'north', 6, 'east', 5, 'depth', 2.5);
%   uuv.wait('uuv1', 30);                             % s; an error if it does not come to it
%   uuv.tell('uuv1', 'follow', 'path', [6 6 2; 8 6 2], 'speed', 0.5);
%   uuv.tell('uuv1', 'thrust', 'newtons', [1 1 1 1 0 0]);
%   uuv.subscribe('uuv1', 'imu', 50);                 % Hz
%   sample = uuv.next(1);                             % the next of what was subscribed to; [] after 1 s without
%   uuv.tell('uuv1', 'stop');
%   uuv.close();                                      % stops what was told something
%
% Commands need the token that the gateway shows when it starts. On the gateway's own machine it is read from its file.
% A vehicle stops when nothing is sent to the gateway for DEADMAN seconds (10), so repeat a command, wait, or get.
% Units are SI and radians, places NED with depth down, what is along the body is FRD. What can be told, and what comes,
% is listed in docs/how-to/matlab.md. Errors are those of the gateway, one line each.
classdef uuv_hil < handle
  properties (Access = private)
    link
    buffer = '';     % what has come of a line
    lines = {};      % whole lines that nobody has taken yet
    samples = {};    % those that came by themselves
    number = 0;
  end

  methods
    function self = uuv_hil(host, port, token, deadman)
      if nargin < 1
        host = '127.0.0.1';
      end
      if nargin < 2
        port = 7450;
      end
      if nargin < 3 || isempty(token)
        token = uuv_hil.token_of(port);
      end
      if nargin < 4
        deadman = 10;
      end
      if exist('OCTAVE_VERSION', 'builtin')
        pkg('load', 'instrument-control');
      end
      self.link = tcpclient(host, port);
      if ~isempty(token)
        self.ask(struct('do', 'login', 'token', token, 'deadman', deadman));
      end
    end

    function names = vehicles(self)
      % Who is there, as a cell array.
      answer = self.ask(struct('do', 'vehicles'));
      names = answer.vehicles;
      if ischar(names)
        names = {names};
      end
    end

    function sample = get(self, vehicle, sensor)
      % The newest sample of a sensor; its age in s is a field of it.
      answer = self.ask(struct('do', 'get', 'vehicle', vehicle, 'sensor', sensor));
      sample = answer.sample;
      sample.age = answer.age;
    end

    function tell(self, vehicle, what, varargin)
      % Tell a vehicle what to do; the arguments by name.
      self.ask(struct('do', what, 'vehicle', vehicle, varargin{:}));
    end

    function wait(self, vehicle, seconds)
      % Wait until what the vehicle was told last is done.
      began = tic;
      answer = self.ask(struct('do', 'status', 'vehicle', vehicle));
      while ~answer.done
        if answer.over
          error('uuv_hil:over', '%s does not come to what was asked: %s', vehicle, answer.error);
        elseif toc(began) > seconds
          error('uuv_hil:late', '%s has not come to what was asked within %g s', vehicle, seconds);
        end
        pause(0.05);
        answer = self.ask(struct('do', 'status', 'vehicle', vehicle));
      end
    end

    function subscribe(self, vehicle, sensor, rate)
      % Let samples come by themselves, so many a second at most; see next.
      self.ask(struct('do', 'subscribe', 'vehicle', vehicle, 'sensor', sensor, 'rate', rate));
    end

    function unsubscribe(self, vehicle, sensor)
      self.ask(struct('do', 'unsubscribe', 'vehicle', vehicle, 'sensor', sensor));
    end

    function message = next(self, seconds)
      % The next of what was subscribed to, with the fields vehicle, sensor, age, sample; [] if none comes in time.
      began = tic;
      while isempty(self.samples) && toc(began) < seconds
        self.take();
      end
      message = [];
      if ~isempty(self.samples)
        message = self.samples{1};
        self.samples(1) = [];
      end
    end

    function close(self)
      % Both close a connection that nothing refers to any more.
      self.link = [];
    end
  end

  methods (Static)
    function token = token_of(port)
      % The token of the gateway at that port of this machine; '' if there is none.
      home = getenv('XDG_STATE_HOME');
      if isempty(home)
        home = fullfile(getenv('HOME'), '.local', 'state');
      end
      file = fullfile(home, 'uuv-hil', sprintf('gateway-%d.token', port));
      token = '';
      if exist(file, 'file')
        token = strtrim(fileread(file));
      end
    end
  end

  methods (Access = private)
    function answer = ask(self, request)
      self.number = self.number + 1;
      request.id = self.number;
      write(self.link, uint8([jsonencode(request) char(10)]));
      began = tic;
      answer = [];
      while isempty(answer)
        if toc(began) > 40
          error('uuv_hil:silent', 'the gateway does not answer; is `uuv-hil gateway` still running?');
        end
        answer = self.take();
        if ~isempty(answer) && ~isequal(answer.id, self.number) && ~isempty(answer.id)
          answer = [];   % to a question that was given up
        end
      end
      if ~answer.ok
        error('uuv_hil:refused', '%s', answer.error);
      end
    end

    function answer = take(self)
      % One line that has come: an answer is given back, a sample is kept for next.
      answer = [];
      if isempty(self.lines)
        self.listen();
      end
      if isempty(self.lines)
        pause(0.001);
        return
      end
      message = jsondecode(self.lines{1});
      self.lines(1) = [];
      if isfield(message, 'ok')
        answer = message;
      else
        self.samples{end + 1} = message;
      end
    end

    function listen(self)
      % A line buffer of our own: Octave's readline drops what follows the first line.
      count = self.link.NumBytesAvailable;
      if count > 0
        self.buffer = [self.buffer char(read(self.link, count))];
        parts = strsplit(self.buffer, char(10));
        self.buffer = parts{end};
        self.lines = [self.lines parts(1:end - 1)];
      end
    end
  end
end
