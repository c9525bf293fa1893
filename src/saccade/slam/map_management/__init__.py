"""Confirmation of new landmarks, and culling of wrong ones."""
