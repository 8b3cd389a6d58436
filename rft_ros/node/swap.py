"""Tool swaps: the tool in force, the tools requested since, and the fallback of a failed swap."""

from rft_ros.node.tool_worker import ToolWorker
from rft_ros.tool import Tool, ToolRequest


class ToolSwap:
    """One tool in force and a stack of requested ones; the newest is being loaded.

    Once it is loaded, it comes into force and the stack is cleared. If it fails, the request before it is next.
    """

    def __init__(self, in_force: ToolRequest, worker: ToolWorker) -> None:
        self._worker = worker
        self._in_force = in_force
        self._stack: list[ToolRequest] = []
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""

    @property
    def wanted(self) -> ToolRequest:
        """The newest request, else the tool in force: the values that the parameters should have."""
        return self._stack[-1] if self._stack else self._in_force

    @property
    def preparing(self) -> str:
        """`mesh.file` of the tool that is being loaded; empty if none is."""
        return self._worker.loading.file if self._worker.loading else ""

    def knows(self, request: ToolRequest) -> bool:
        """Whether this tool is in force or requested."""
        return request == self._in_force or request in self._stack

    def want(self, request: ToolRequest) -> None:
        """Request a tool: load it, unless it is in force or being loaded already."""
        if request == self._in_force:
            self._stack.clear()
            self._worker.cancel()
        elif request != self._worker.loading:
            self._stack = [r for r in self._stack if r != request] + [request]
            self._worker.load(request)

    def poll(self) -> Tool | ToolRequest | None:
        """The tool that came into force or the request that failed since the last call, else None."""
        answer = self._worker.poll()
        if answer is None:
            return None
        if isinstance(answer, Tool):
            self._in_force = self._stack[-1]
            self._stack.clear()
            self.last_failure = ""
            return answer
        self.last_failure = answer
        return self._stack.pop()
