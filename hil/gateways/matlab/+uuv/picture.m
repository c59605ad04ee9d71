function pixels = picture(sample)
% PICTURE  The pixels of a camera's sample: rows x columns x 3 (uint8), or rows x columns (m, or labels).
  data = matlab.net.base64decode(sample.data);
  switch sample.encoding
    case 'jpeg'
      pixels = read_jpeg(data);
    case 'rgb8'
      pixels = permute(reshape(data, 3, sample.width, sample.height), [3 2 1]);
    case 'mono8'
      pixels = reshape(data, sample.width, sample.height).';
    case '32FC1'
      pixels = reshape(typecast(data, 'single'), sample.width, sample.height).';
    case '32SC1'
      pixels = reshape(typecast(data, 'int32'), sample.width, sample.height).';
    otherwise
      error('uuv:picture', 'pictures of encoding %s are not read here', sample.encoding);
  end
end

function pixels = read_jpeg(data)
  file = [tempname() '.jpg'];
  [handle, problem] = fopen(file, 'w');
  if handle < 0
    error('uuv:picture', 'a JPEG is read from a file, and %s cannot be written: %s', file, problem);
  end
  fwrite(handle, data, 'uint8');
  fclose(handle);
  pixels = imread(file);
  delete(file);
end
