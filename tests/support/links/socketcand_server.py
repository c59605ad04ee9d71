"""A socketcand server with one bus, for tests: it passes what a client sends to all others in raw mode."""

import re
import socketserver
import threading


class SocketcandServer(socketserver.ThreadingTCPServer):
    """Serves at `port` of localhost until closed. `opened`: the buses that clients have opened."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Client)
        self.port: int = self.server_address[1]
        self.opened: list[str] = []
        self.clients: list[_Client] = []
        self._thread = threading.Thread(target=self.serve_forever, args=(0.01,))
        self._thread.start()

    def close(self) -> None:
        """End; the clients have to be closed."""
        self.shutdown()
        self._thread.join()
        self.server_close()


class _Client(socketserver.BaseRequestHandler):
    server: SocketcandServer

    def handle(self) -> None:
        self.request.sendall(b"< hi >")
        text = ""
        while received := self.request.recv(4096):
            *elements, text = re.split("(?<=>)", text + received.decode())
            for element in elements:
                self._take(element.strip("<> ").split())
        self.server.clients.remove(self)

    def _take(self, words: list[str]) -> None:
        if words[0] == "send":
            number, data = words[1], bytes(int(word, 16) for word in words[3:]).hex()
            for other in self.server.clients:
                if other is not self:
                    other.request.sendall(f"< frame {number} 12.345678 {data} >".encode())
            return
        if words[0] == "open":
            self.server.opened.append(words[1])
        else:
            self.server.clients.append(self)
        self.request.sendall(b"< ok >")
