function intensities = echoes(sample)
% ECHOES  The echoes of a forward-looking sonar's sample: a row a range bin, the nearest first; a column a beam.
  data = matlab.net.base64decode(sample.intensities);
  if strcmp(sample.encoding, 'float32')
    data = typecast(data, 'single');
  end
  intensities = reshape(data, numel(sample.beams), sample.bins).';
end
