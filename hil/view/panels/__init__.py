"""What the page's panels show and do: readings, health, pictures, and the actions of their buttons.

Public: `actions.Actions`, `readings`, `pictures`. It must not know how the page looks.
"""
