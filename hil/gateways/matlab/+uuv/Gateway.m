% The connection to `uuv-hil gateway json`: what uuv.Vehicle speaks over. For MATLAB (R2020b) and GNU Octave.
%
%   gateway = uuv.Gateway();                                   % the one of this machine, at port 7450
%   gateway = uuv.Gateway('192.168.3.5', 7450, TOKEN);         % on another one: TOKEN is what it showed at its start
%   gateway = uuv.Gateway('127.0.0.1', 7450, TOKEN, DEADMAN);  % s without a line, after which vehicles stop (10)
%   names = gateway.vehicles();                                % who is there, as a cell array
%   gateway.close();                                           % stops what was commanded
%
% Commands need the token; reading does not. On the gateway's own machine the token is read from its file.
% Errors: uuv:noGateway (nobody listens there), uuv:lost (the connection has ended), uuv:token (none, or not this one),
% uuv:refused (the gateway's own words: what is wrong, and what to do).
classdef Gateway < handle
  properties (SetAccess = private)
    host
    port
    may_command = false;
  end

  properties (Access = private)
    link = [];
    chunks = {};     % what has come of a line
    lines = {};      % whole lines that nobody has taken yet
    samples = {};    % those that came by themselves
    number = 0;
    probed = [];     % when (tic) it was last seen that the connection is there
    is_octave
  end

  methods
    function self = Gateway(host, port, token, deadman)
      if nargin < 1 || isempty(host)
        host = '127.0.0.1';
      end
      if nargin < 2 || isempty(port)
        port = 7450;
      end
      if nargin < 3 || isempty(token)
        token = uuv.Gateway.token_of(port);
      end
      if nargin < 4
        deadman = 10;
      end
      self.host = host;
      self.port = port;
      self.is_octave = exist('OCTAVE_VERSION', 'builtin') ~= 0;
      if self.is_octave
        pkg('load', 'instrument-control');
      end
      try
        self.link = tcpclient(host, port);
      catch problem
        error('uuv:noGateway', ['no gateway answers at %s:%d (%s); start it there: ' ...
          'uuv-hil gateway json --connect tcp/BOARD:7447, with --listen %s:%d if it is not the usual place'], ...
          host, port, uuv.Gateway.one_line(problem.message), host, port);
      end
      if self.is_octave
        self.link.Timeout = 0.01;   % s, of a read that finds nothing: see listen
      end
      if ~isempty(token)
        self.login(token, deadman);
      end
    end

    function names = vehicles(self)
      % Names of the vehicles that are there, as a cell array.
      answer = self.ask(struct('do', 'vehicles'));
      names = answer.vehicles;
      if ischar(names)
        names = {names};
      end
    end

    function answer = ask(self, request)
      % Send a request (a struct, see docs/how-to/matlab.md), and return its answer.
      self.number = self.number + 1;
      request.id = self.number;
      self.send(uint8([jsonencode(request) char(10)]));
      began = tic;
      self.probed = tic;
      answer = [];
      while isempty(answer)
        if toc(began) > 40
          self.fail('has not answered for 40 s');
        end
        answer = self.take();
        if ~isempty(answer) && ~isempty(answer.id) && ~isequal(answer.id, self.number)
          answer = [];   % to a question that was given up
        end
      end
      if ~answer.ok
        error('uuv:refused', '%s', answer.error);
      end
    end

    function answer = command(self, request)
      % The same for what needs the token.
      if ~self.may_command
        error('uuv:token', ['%s needs the token of the gateway at %s:%d, which it showed when it started: ' ...
          'uuv.Gateway(''%s'', %d, TOKEN)'], request.do, self.host, self.port, self.host, self.port);
      end
      answer = self.ask(request);
    end

    function message = next(self, seconds)
      % The next of what was subscribed to, with the fields vehicle, sensor, age, sample; [] if none comes in time.
      began = tic;
      self.probed = tic;
      while isempty(self.samples)
        self.take();
        if isempty(self.samples) && toc(began) > seconds
          break
        end
      end
      message = [];
      if ~isempty(self.samples)
        message = self.samples{1};
        self.samples(1) = [];
      end
    end

    function close(self)
      % Both languages close a connection that nothing refers to any more.
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

    function text = one_line(text)
      text = strtrim(regexprep(text, '\s+', ' '));
    end
  end

  methods (Access = private)
    function login(self, token, deadman)
      try
        self.ask(struct('do', 'login', 'token', token, 'deadman', deadman));
      catch problem
        if isempty(strfind(problem.message, 'token: '))
          rethrow(problem);
        end
        error('uuv:token', 'the gateway at %s:%d refuses: %s', self.host, self.port, problem.message);
      end
      self.may_command = true;
    end

    function send(self, bytes)
      if isempty(self.link)
        self.fail('was closed here');
      end
      try
        write(self.link, bytes);
      catch problem
        self.fail(uuv.Gateway.one_line(problem.message));
      end
    end

    function answer = take(self)
      % One line that has come: an answer is returned, a sample is stored for `next`.
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
      % A line buffer of our own: Octave's readline drops what follows the first line. Nor does it say that a connection
      % has ended before somebody reads where nothing has come.
      if isempty(self.link)
        self.fail('was closed here');
      end
      try
        count = self.link.NumBytesAvailable;
        if count == 0
          if ~self.is_octave || toc(self.probed) < 1
            return
          end
          self.probed = tic;
          count = 1;
        end
        chunk = char(read(self.link, count));
      catch problem
        self.fail(uuv.Gateway.one_line(problem.message));
      end
      self.chunks{end + 1} = reshape(chunk, 1, []);
      if any(chunk == char(10))
        parts = strsplit([self.chunks{:}], char(10));
        self.chunks = parts(end);
        self.lines = [self.lines parts(1:end - 1)];
      end
    end

    function fail(self, why)
      self.link = [];
      error('uuv:lost', ['the connection to the gateway at %s:%d has ended (%s); vehicles that it commanded stop. ' ...
        'See that uuv-hil gateway json runs there, and connect again'], self.host, self.port, why);
    end
  end
end
